// Puts the page together: what the address asks for, the views on the stage, keys and buttons.
//
// The part of the address behind # : keyframe=N (from 1; without it the one that the host chose), mode=optical|rf|both (without it the last of those
// that there are), lock=1, panel=0, and for scripts bare=1 with size=WxH, which
// leave nothing but the picture as that camera sees it and put it, as a PNG, into the attribute data-capture of the page's body.

/** Most device pixels to a pixel of the page. */
const MOST_RATIO = 2;
/** A frame that takes longer than this is drawn smaller next time, milliseconds. */
const SLOW_MS = 45;

class App {
  #dirty = true;
  #shrink = 1;
  #frameAt = 0;

  constructor(scene, source, asked) {
    Object.assign(this, { scene, source, asked });
    this.at = (id) => document.getElementById(id);
    this.view = { eye: [0, 0, 0], yaw: 0, pitch: 0, roll: 0 };
    this.mode = 'optical';
    this.locked = false;
    this.chosen = 0;
    this.ownFov = horizontalFov(scene.modalities.light ? scene.optical_camera : scene.rf_camera);
    this.fov = this.ownFov;
  }

  async start() {
    const { scene, source, asked } = this;
    this.renderer = new Renderer(this.at('picture'), scene, () => {
      this.#say('');
      this.redraw();
    });
    this.overlay = new Overlay(this.at('lines'), scene);
    this.#say('loading …');
    if (scene.field) this.renderer.loadField(await source.bytes('field'), scene.field);
    for (const half of ['optical', 'rf']) if (scene.points[half]) this.renderer.loadPoints(half, await source.bytes(`points-${half}`));
    this.controls = new Controls(this.at('lines'), this.view, {
      changed: () => this.redraw(),
      clicked: (x, y, finger) => this.#clicked(x, y, finger),
      hovered: (x, y) => this.#hovered(x, y),
      focal: () => this.views[0]?.page.fx ?? 500,
    });
    this.views = [];
    const halves = ['optical', 'rf'].filter((half) => scene.growing?.[half] || this.renderer.has(half));
    this.modes = halves.length === 2 ? ['optical', 'rf', 'both'] : halves;
    this.mode = this.modes.includes(asked.get('mode')) ? asked.get('mode') : this.modes.at(-1) ?? 'optical';
    this.locked = asked.get('lock') === '1' && scene.modalities.radio;
    const number = Number(asked.get('keyframe') ?? scene.opening + 1);
    this.chosen = Number.isInteger(number) ? clamp(number - 1, 0, scene.keyframes.length - 1) : scene.opening;
    if (asked.get('bare') === '1') return this.#bare(asked.get('size'));
    this.panel = new Panel(scene, source, (index) => this.choose(index));
    this.#chrome();
    this.choose(this.chosen);
    new ResizeObserver(() => this.redraw()).observe(this.at('stage'));
    window.addEventListener('keydown', (e) => this.#key(e));
    this.at('picture').addEventListener('webglcontextlost', () => this.#say('The graphics device was lost: load the page again.', true));
    const frame = (now) => {
      if (this.controls.fly(now)) this.#dirty = true;
      if (this.#dirty) this.#draw(now);
      requestAnimationFrame(frame);
    };
    requestAnimationFrame(frame);
    if (scene.growing) this.#grow();
  }

  /** Takes every new field of a reconstruction at work, and leaves the camera where it is. */
  #grow() {
    this.#say('waiting for the first keyframes …');
    const field = (buffer, layout) => {
      const first = !this.scene.field;
      this.scene.field = layout;
      this.renderer.loadField(buffer, layout);
      // What is turned around lies where there is something now.
      if (first) this.controls.distance = this.#ahead();
    };
    const told = (keyframes) => {
      if (keyframes === this.overlay.grown) return;
      this.overlay.grown = keyframes;
      this.panel.grown(keyframes);
      this.redraw();
    };
    new Growth(this.scene, this.source, { field, told }).follow().then(() => this.scene.field || this.#say(''));
  }

  redraw() {
    this.#dirty = true;
  }

  /** Nothing but the picture of one half, as its own camera takes it at a keyframe. */
  #bare(size) {
    document.body.classList.add('bare');
    const half = this.mode === 'both' ? 'optical' : this.mode;
    const camera = half === 'rf' ? this.scene.rf_camera : this.scene.optical_camera;
    const [width, height] = /^\d+x\d+$/.test(size ?? '') ? size.split('x').map(Number) : [camera.width, camera.height];
    const canvas = this.at('picture');
    Object.assign(canvas.style, { width: `${width}px`, height: `${height}px` });
    Object.assign(this.view, viewOfPose(this.scene.keyframes[this.chosen].pose));
    const axes = axesOf(this.view), { eye } = this.view;
    const draw = () => {
      if (!this.renderer.order(axes, eye)) return;
      this.renderer.clear(width, height);
      this.renderer.draw(half, axes, eye, scaledCamera(camera, width, height), { x: 0, y: 0, width, height }, true);
      document.body.dataset.capture = canvas.toDataURL();
    };
    this.renderer.drawn = draw;
    draw();
  }

  /** Goes to a keyframe. */
  choose(index) {
    const { scene } = this;
    if (!(index >= 0 && index < scene.keyframes.length)) return;
    this.chosen = index;
    this.#home();
    this.panel.show(index);
    this.#remember();
  }

  /** Back to the chosen keyframe's pose, with its camera's field of view. */
  #home() {
    Object.assign(this.view, viewOfPose(this.scene.keyframes[this.chosen].pose));
    this.fov = this.ownFov;
    this.controls.distance = this.#ahead();
    this.#update();
  }

  /** The distance of what lies in the middle of the view: the median of what is drawn there. */
  #ahead() {
    const axes = axesOf(this.view), { positions } = this.renderer, depths = [];
    for (let i = 0; i < positions.length; i += 3) {
      const p = toCamera(axes, this.view.eye, [positions[i], positions[i + 1], positions[i + 2]]);
      if (p[2] > 0.3 && Math.hypot(p[0], p[1]) < 0.15 * p[2]) depths.push(p[2]);
    }
    return depths.length ? clamp(depths.sort((a, b) => a - b)[depths.length >> 1], 0.5, 8) : 2.5;
  }

  #remember() {
    const parts = [`keyframe=${this.chosen + 1}`, `mode=${this.mode}`, ...(this.locked ? ['lock=1'] : [])];
    history.replaceState(null, '', `#${parts.join('&')}`);
  }

  /** Buttons, and what they say. */
  #chrome() {
    const { scene } = this;
    const heading = this.at('title');
    heading.replaceChildren(scene.title, make('small', { textContent: scene.subtitle }));
    heading.title = scene.about;
    const on = (id, act) => this.at(id).addEventListener('click', act);
    this.at('modes').addEventListener('click', (e) => e.target.dataset.mode && this.#setMode(e.target.dataset.mode));
    for (const button of this.at('modes').children) {
      button.disabled = !this.modes.includes(button.dataset.mode);
      if (button.disabled) button.title = scene.missing;
    }
    this.at('lock').disabled = !scene.modalities.radio;
    on('lock', () => this.#setLock(!this.locked));
    on('around', () => this.#setAround(!this.controls.around));
    on('reset', () => this.#home());
    on('help', () => this.at('keys').showModal());
    on('fold', () => this.#fold());
    this.at('fov').addEventListener('input', (e) => {
      this.fov = Number(e.target.value);
      this.#setLock(false);
    });
    if (scene.modalities.radio) this.at('scale').append(powerBar(scene));
    if (this.asked.get('panel') === '0') this.#fold();
    if (!this.modes.length) this.#say(scene.missing);
    else if (!scene.field && !scene.growing) this.#say('');
    for (const note of scene.notes) this.at('legend').after(make('p', { className: 'note', textContent: note }));
    this.#update();
  }

  #setMode(mode) {
    if (this.modes.includes(mode)) this.mode = mode;
    this.#update();
    this.#remember();
  }

  #setLock(locked) {
    this.locked = locked && this.scene.modalities.radio;
    this.#update();
    this.#remember();
  }

  #setAround(around) {
    this.controls.around = around;
    this.#update();
  }

  #fold() {
    const folded = document.body.classList.toggle('folded');
    this.at('fold').setAttribute('aria-expanded', String(!folded));
    this.redraw();
  }

  #update() {
    for (const button of this.at('modes').children) button.setAttribute('aria-pressed', String(button.dataset.mode === this.mode));
    this.at('lock').setAttribute('aria-pressed', String(this.locked));
    this.at('around').setAttribute('aria-pressed', String(this.controls.around));
    this.at('fov').value = this.fov;
    const shown = this.locked ? horizontalFov(this.scene.rf_camera) : this.fov;
    this.at('fov-value').textContent = `${shown.toFixed(0)}°`;
    this.at('scale').hidden = this.mode === 'optical' || !this.scene.modalities.radio;
    this.redraw();
  }

  #say(text, error = false) {
    Object.assign(this.at('message'), { textContent: text, className: error ? 'error' : '' });
  }

  #key(e) {
    if (e.ctrlKey || e.metaKey || e.altKey || document.querySelector('dialog[open]')) return;
    const slider = e.target.id === 'slider';
    const act = {
      ArrowLeft: () => slider || this.choose(this.chosen - 1),
      ArrowRight: () => slider || this.choose(this.chosen + 1),
      r: () => this.#home(),
      l: () => this.#setLock(!this.locked),
      t: () => this.#setAround(!this.controls.around),
      p: () => this.#fold(),
      1: () => this.#setMode('optical'),
      2: () => this.#setMode('rf'),
      3: () => this.#setMode('both'),
      '?': () => this.at('keys').showModal(),
    }[e.key.length === 1 ? e.key.toLowerCase() : e.key];
    if (!act || e.target.id === 'fov') return;
    if (e.key.startsWith('Arrow') && !slider) e.preventDefault();
    act();
  }

  /** The views on the stage: which half, where on the page, through which camera. */
  #layout(width, height) {
    const { scene } = this, halves = this.mode === 'both' ? ['optical', 'rf'] : [this.mode];
    const shape = this.locked || !scene.modalities.light ? scene.rf_camera : scene.optical_camera, gap = halves.length > 1 ? 2 : 0;
    // Beside each other, unless they are much larger above each other.
    const fit = (w, h) => Math.min(w / shape.width, h / shape.height);
    const beside = 1.5 * fit(width / 2, height) >= fit(width, height / 2);
    return halves.map((half, i) => {
      const part = halves.length === 1 ? { x: 0, y: 0, width, height }
        : beside ? { x: Math.round(i * (width + gap) / 2), y: 0, width: Math.floor((width - gap) / 2), height }
          : { x: 0, y: Math.round(i * (height + gap) / 2), width, height: Math.floor((height - gap) / 2) };
      if (!this.locked) return { half, place: part, page: cameraOfView(part.width, part.height, this.fov, shape) };
      const { rf_camera: rf } = scene, scale = fit(part.width, part.height);
      const inner = { width: Math.max(1, Math.round(rf.width * scale)), height: Math.max(1, Math.round(rf.height * scale)) };
      const place = { ...inner, x: part.x + Math.floor((part.width - inner.width) / 2), y: part.y + Math.floor((part.height - inner.height) / 2) };
      return { half, place, page: scaledCamera(rf, inner.width, inner.height) };
    });
  }

  #draw(now) {
    this.#dirty = false;
    const stage = this.at('stage'), [width, height] = [stage.clientWidth, stage.clientHeight];
    if (!width || !height) return;
    if (this.controls.moving) {
      if (now - this.#frameAt > SLOW_MS && now - this.#frameAt < 1000) this.#shrink = Math.max(0.35, this.#shrink * 0.85);
    } else if (this.#shrink !== 1) {
      this.#shrink = 1;
    }
    this.#frameAt = now;
    const ratio = Math.min(MOST_RATIO, window.devicePixelRatio || 1), fine = ratio * this.#shrink;
    const axes = axesOf(this.view), { eye } = this.view, { renderer, overlay } = this;
    renderer.order(axes, eye);
    this.views = this.#layout(width, height);
    renderer.clear(Math.round(width * ratio), Math.round(height * ratio));
    overlay.clear(Math.round(width * ratio), Math.round(height * ratio), ratio);
    for (const { half, place, page } of this.views) {
      const device = Object.fromEntries(Object.entries(place).map(([k, v]) => [k, Math.round(v * ratio)]));
      // Inside its own frame a spectrum has its own pixels, and no others.
      const own = this.locked && half === 'rf';
      const camera = own ? this.scene.rf_camera : scaledCamera(page, Math.max(1, Math.round(place.width * fine)), Math.max(1, Math.round(place.height * fine)));
      renderer.draw(half, axes, eye, camera, device, own);
      overlay.draw(axes, eye, page, place, this.chosen, half === 'rf' && !this.locked ? this.scene.rf_camera : null);
    }
    this.#readout(axes);
  }

  #readout(axes) {
    const { eye } = this.view, azimuth = degrees(Math.atan2(axes.forward[1], axes.forward[0]));
    const elevation = degrees(Math.asin(clamp(axes.forward[2], -1, 1)));
    this.at('readout').textContent = `${eye.map((v) => decibels(v, 2)).join(', ')} m · looking ${decibels(azimuth)}°, ${decibels(elevation)}°`;
  }

  /** The view under a place of the stage, and the place within it. */
  #under(x, y) {
    for (const view of this.views) {
      const { place } = view, [u, v] = [x - place.x, y - place.y];
      if (u >= 0 && v >= 0 && u < place.width && v < place.height) return { view, u, v };
    }
    return null;
  }

  #clicked(x, y, finger) {
    const under = this.#under(x, y), grace = finger ? FINGER_PX : GRACE_PX;
    const hit = under ? this.overlay.hit(axesOf(this.view), this.view.eye, under.view.page, under.u, under.v, grace) : -1;
    if (hit >= 0) this.choose(hit);
  }

  #hovered(x, y) {
    const under = this.#under(x, y);
    const hit = under ? this.overlay.hit(axesOf(this.view), this.view.eye, under.view.page, under.u, under.v) : -1;
    if (hit !== this.overlay.hovered) {
      this.overlay.hovered = hit;
      this.at('lines').classList.toggle('over', hit >= 0);
      this.redraw();
    }
    this.at('cursor').textContent = under?.view.half === 'rf' ? this.#level(under) : '';
  }

  /** What the radio field is worth under the cursor. */
  #level({ view, u, v }) {
    const size = this.renderer.size('rf'), { scene } = this;
    const colour = this.renderer.pixel('rf', u / view.place.width * size.width, v / view.place.height * size.height);
    if (!colour) return '';
    const level = scene.field.rf.channels === 1 ? clamp(colour[0], 0, 1) : levelOfColour(scene.ramps.jet, colour);
    const { min_db: low, max_db: high } = scene.db_range, angles = anglesOfPixel(view.page, u, v);
    const power = level > 0 ? `${decibels(low + level * (high - low), 1)} dB` : `under ${decibels(low)} dB`;
    return `${power} from azimuth ${decibels(angles.azimuth)}°, elevation ${decibels(angles.elevation)}° of straight ahead`;
  }
}

(async () => {
  try {
    const source = openSource(), asked = new URLSearchParams(location.hash.slice(1));
    await new App(await source.json('scene'), source, asked).start();
  } catch (error) {
    Object.assign(document.getElementById('message'), { textContent: error.message, className: 'error' });
    document.body.dataset.error = error.message;
  }
})();
