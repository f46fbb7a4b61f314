// Pictures of spectra and of errors from their numbers, and the bars that say what a colour is.

/** A spectrum's levels in [0, 1] from base64 of 16 bits each. */
function levelsOf(base64) {
  const bytes = bytesOf(base64), view = new DataView(bytes.buffer);
  return Float32Array.from({ length: bytes.length / 2 }, (_, i) => view.getUint16(2 * i, true) / 65535);
}

/** A canvas of levels in [0, 1] through a ramp of colours. */
function levelsCanvas(levels, width, height, ramp) {
  const canvas = document.createElement('canvas');
  [canvas.width, canvas.height] = [width, height];
  const ink = canvas.getContext('2d'), picture = ink.createImageData(width, height);
  for (let i = 0; i < levels.length; i++) {
    const [r, g, b] = ramp[Math.round(clamp(levels[i], 0, 1) * (ramp.length - 1))];
    picture.data.set([r, g, b, 255], 4 * i);
  }
  ink.putImageData(picture, 0, 0);
  return canvas;
}

/** The level whose colour in the ramp is nearest. */
function levelOfColour(ramp, colour) {
  let best = 0, least = Infinity;
  for (let i = 0; i < ramp.length; i++) {
    const distance = ramp[i].reduce((sum, v, c) => sum + (v / 255 - colour[c]) ** 2, 0);
    if (distance < least) [best, least] = [i, distance];
  }
  return best / (ramp.length - 1);
}

/** A bar of colours with numbers under it. */
function barOf(ramp, ticks, title) {
  const bar = document.createElement('div');
  bar.className = 'bar';
  bar.title = title;
  const stops = Array.from({ length: 33 }, (_, i) => `rgb(${ramp[Math.round(i / 32 * (ramp.length - 1))].join()})`);
  const colours = document.createElement('i');
  colours.style.background = `linear-gradient(to right,${stops.join()})`;
  const numbers = document.createElement('div');
  for (const tick of ticks) numbers.append(Object.assign(document.createElement('span'), { textContent: tick }));
  bar.append(colours, numbers);
  return bar;
}

/** Decibels without a hyphen for a minus. */
function decibels(db, digits = 0) {
  const text = Math.abs(db).toFixed(digits);
  return (db < 0 && Number(text) !== 0 ? '−' : '') + text;
}

/** The bar of spectra. */
function powerBar(scene, count = 4) {
  const { min_db: low, max_db: high } = scene.db_range;
  const ticks = Array.from({ length: count }, (_, i) => decibels(low + (high - low) * i / (count - 1)) + (i === count - 1 ? ' dB' : ''));
  return barOf(scene.ramps.jet, ticks, `Received power by colour: ${scene.unit}`);
}

/** Draws rings around peaks onto the canvas of a spectrum, large enough to be numbered. */
function marked(canvas, peaks) {
  const scale = Math.max(1, Math.round(720 / canvas.width));
  const large = document.createElement('canvas');
  [large.width, large.height] = [canvas.width * scale, canvas.height * scale];
  const ink = large.getContext('2d');
  ink.imageSmoothingEnabled = false;
  ink.drawImage(canvas, 0, 0, large.width, large.height);
  const r = 0.018 * large.width;
  ink.font = `600 ${Math.round(0.042 * large.width)}px system-ui, sans-serif`;
  ink.textBaseline = 'middle';
  peaks.forEach(({ x, y }, i) => {
    const [u, v] = [x * large.width, y * large.height];
    for (const [width, colour] of [[0.012, '#000a'], [0.005, '#fff']]) {
      ink.lineWidth = width * large.width;
      ink.strokeStyle = colour;
      ink.beginPath();
      ink.arc(u, v, r, 0, 2 * Math.PI);
      ink.stroke();
    }
    const left = u > 0.93 * large.width;
    ink.textAlign = left ? 'right' : 'left';
    const at = u + (left ? -1 : 1) * 1.6 * r;
    ink.lineWidth = 0.01 * large.width;
    ink.strokeStyle = '#000a';
    ink.strokeText(i + 1, at, v);
    ink.fillStyle = '#fff';
    ink.fillText(i + 1, at, v);
  });
  return large;
}
