// The panel beside the view: which keyframe, and what was observed, predicted and wrong there.

const ROLES = {
  train: ['trained on', 'The reconstruction has seen this keyframe: what it predicts here says little about places it has not seen'],
  test: ['test', 'Held out: the reconstruction has never seen this keyframe, so its error here is an honest one'],
  other: ['left out', 'Neither trained on nor evaluated in this run'],
};
const DATASET_ROLES = {
  train: ['for training', 'Reconstructions learn from this keyframe'],
  test: ['test', 'Reconstructions do not see this keyframe and are judged by it'],
  other: ['left out', 'Neither trained on nor tested'],
};

const make = (tag, properties = {}, ...children) => {
  const element = Object.assign(document.createElement(tag), properties);
  element.append(...children);
  return element;
};

class Panel {
  #asked = -1;
  #kept = new Map();

  /** `choose` is called with the index of a keyframe that somebody picks. */
  constructor(scene, source, choose) {
    Object.assign(this, { scene, source, choose, index: 0 });
    this.at = (id) => document.getElementById(id);
    const roles = this.roles = scene.run ? ROLES : DATASET_ROLES;
    const slider = this.at('slider');
    slider.max = scene.keyframes.length;
    slider.addEventListener('input', () => choose(Number(slider.value) - 1));
    this.at('previous').addEventListener('click', () => choose(this.index - 1));
    this.at('next').addEventListener('click', () => choose(this.index + 1));
    const strip = this.at('strip');
    strip.append(...scene.keyframes.map((k, i) => make('i', { className: k.role, title: `keyframe ${i + 1}, ${roles[k.role][0]}` })));
    strip.addEventListener('click', (e) => {
      const i = [...strip.children].indexOf(e.target);
      if (i >= 0) choose(i);
    });
    const colours = { train: '#37506f', test: '#ffb454', other: '#434a55' };
    for (const role of ['train', 'test', 'other']) {
      const count = scene.keyframes.filter((k) => k.role === role).length;
      if (!count) continue;
      const swatch = make('i');
      swatch.style.background = colours[role];
      this.at('legend').append(swatch, make('span', { textContent: `${count} ${roles[role][0]}`, title: roles[role][1] }));
    }
    if (scene.growing) {
      this.at('legend').append(make('span', { className: 'ahead', textContent: 'faint: to come' }));
      this.grown(0);
    }
    const large = this.at('large');
    large.addEventListener('click', (e) => e.target === large && large.close());
  }

  /** Of a reconstruction at work: its first `count` training keyframes are done. */
  grown(count) {
    const cells = [...this.at('strip').children].filter((_, i) => this.scene.keyframes[i].role === 'train');
    cells.forEach((cell, i) => cell.classList.toggle('ahead', i >= count));
  }

  /** Shows a keyframe. */
  async show(index) {
    this.index = index;
    const keyframe = this.scene.keyframes[index], [name, title] = this.roles[keyframe.role];
    this.at('name').textContent = `Keyframe ${index + 1} of ${this.scene.keyframes.length}`;
    Object.assign(this.at('role'), { textContent: name, title, className: keyframe.role });
    this.at('slider').value = index + 1;
    this.at('previous').disabled = index === 0;
    this.at('next').disabled = index === this.scene.keyframes.length - 1;
    [...this.at('strip').children].forEach((cell, i) => cell.classList.toggle('chosen', i === index));
    this.#asked = index;
    let data = this.#kept.get(index);
    if (!data) {
      // Somebody who drags the slider passes over many.
      await new Promise((done) => setTimeout(done, 60));
      if (this.#asked !== index) return;
      try {
        data = await this.source.json(`keyframe-${index + 1}`);
      } catch (error) {
        if (this.#asked === index) this.at('details').replaceChildren(make('p', { className: 'note', textContent: error.message }));
        return;
      }
      this.#kept.set(index, data);
      if (this.#kept.size > 40) this.#kept.delete(this.#kept.keys().next().value);
    }
    if (this.#asked === index) this.at('details').replaceChildren(...this.#details(data));
  }

  #details(data) {
    const out = [];
    if (data.spectrum) out.push(...this.#spectrum(data.spectrum, this.#numbers(data.numbers, 'spectrum')));
    if (data.image) out.push(...this.#image(data.image, this.#numbers(data.numbers, 'image')));
    const learnt = data.numbers.length && this.scene.keyframes[this.index].role === 'train';
    const notes = [data.note, learnt && 'The reconstruction was trained on this keyframe: its numbers are not those of places it has not seen.'];
    out.push(...notes.filter(Boolean).map((textContent) => make('p', { className: 'note', textContent })));
    return out;
  }

  #figure(picture, caption, title, ...below) {
    const figure = make('figure', {}, picture, make('figcaption', { textContent: caption, title }), ...below);
    picture.addEventListener('click', () => this.#enlarge(figure));
    return figure;
  }

  #enlarge(figure) {
    const copy = figure.cloneNode(true), from = figure.firstChild;
    // A cloned canvas is empty.
    if (from instanceof HTMLCanvasElement) copy.firstChild.getContext('2d').drawImage(from, 0, 0);
    this.at('large').querySelector('div').replaceChildren(copy);
    this.at('large').showModal();
  }

  #spectrum(s, numbers) {
    const { scene } = this, { width, height } = s;
    const { min_db: low, max_db: high } = scene.db_range;
    const observed = levelsOf(s.observed), predicted = s.predicted && levelsOf(s.predicted);
    const canvas = (levels, peaks, name) => {
      const picture = marked(levelsCanvas(levels, width, height, scene.ramps.jet), peaks);
      picture.setAttribute('role', 'img');
      picture.setAttribute('aria-label', `spectrum, ${name}`);
      picture.addEventListener('mousemove', (e) => {
        const x = clamp(e.offsetX / picture.clientWidth, 0, 0.9999), y = clamp(e.offsetY / picture.clientHeight, 0, 0.9999);
        const level = levels[Math.floor(y * height) * width + Math.floor(x * width)];
        const angles = anglesOfPixel(scene.rf_camera, x * scene.rf_camera.width, y * scene.rf_camera.height);
        picture.title = `${level > 0 ? `${decibels(low + level * (high - low), 1)} dB` : `no power above ${decibels(low, 1)} dB`}, ` +
          `azimuth ${decibels(angles.azimuth, 1)}°, elevation ${decibels(angles.elevation, 1)}°`;
      });
      return picture;
    };
    const figures = [this.#figure(canvas(observed, s.peaks_observed, 'observed'), 'observed', 'What the receiver measured', powerBar(scene))];
    if (predicted) {
      figures.push(this.#figure(canvas(predicted, s.peaks_predicted, 'predicted'), 'predicted', 'What the reconstruction says it measures', powerBar(scene)));
      const full = scene.error_db;
      const errors = Float32Array.from(observed, (o, i) => Math.abs(predicted[i] - o) * (high - low) / full);
      const picture = marked(levelsCanvas(errors, width, height, scene.ramps.heat), []);
      picture.setAttribute('role', 'img');
      picture.setAttribute('aria-label', 'spectrum, absolute error');
      const bar = barOf(scene.ramps.heat, ['0', `${full / 2}`, `≥ ${full} dB`], 'Absolute error, decibels');
      figures.push(this.#figure(picture, 'absolute error', 'Predicted minus observed, without sign', bar));
    }
    return [
      make('h2', {}, 'Spectrum ', make('small', { textContent: scene.unit_short, title: scene.unit })),
      make('div', { className: 'figures' }, ...figures, ...numbers),
      this.#peaks(s, Boolean(predicted)),
    ];
  }

  #peaks(s, both) {
    const columns = [['observed', s.peaks_observed], ...(both ? [['predicted', s.peaks_predicted]] : [])];
    const most = Math.max(...columns.map(([, peaks]) => peaks.length));
    if (!most) return make('p', { className: 'note', textContent: 'No power arrives from the directions in this frame.' });
    const cells = (peak) => (peak ? [`${decibels(peak.azimuth_deg)}°`, `${decibels(peak.elevation_deg)}°`, `${decibels(peak.db)} dB`] : ['', '', ''])
      .map((textContent) => make('td', { textContent }));
    const rows = Array.from({ length: most }, (_, i) => make('tr', {}, make('th', {}, make('i', { textContent: i + 1 })),
      ...columns.flatMap(([, peaks]) => cells(peaks[i]))));
    const title = 'The strongest directions, numbered in the pictures. Azimuth is positive to the left of straight ahead, elevation above it';
    const head = [
      make('tr', {}, make('th', { textContent: 'peaks' }), ...columns.map(([textContent]) => make('th', { textContent, colSpan: 3 }))),
      make('tr', {}, make('th'), ...columns.flatMap(() => ['azim.', 'elev.', 'level']).map((textContent) => make('th', { textContent }))),
    ];
    return make('table', { className: 'numbers peaks', title }, make('thead', {}, ...head), make('tbody', {}, ...rows));
  }

  #image(image, numbers) {
    const picture = (url, name) => make('img', { src: url, alt: `image, ${name}` });
    const figures = [this.#figure(picture(image.observed, 'observed'), 'observed', 'What the camera saw')];
    if (image.predicted) {
      figures.push(this.#figure(picture(image.predicted, 'predicted'), 'predicted', 'What the reconstruction says it sees'));
      const full = this.scene.error_share * 100;
      const bar = barOf(this.scene.ramps.heat, ['0', `${full / 2}`, `≥ ${full} %`], 'Absolute error, mean over colours, in per cent of full scale');
      figures.push(this.#figure(picture(image.error, 'absolute error'), 'absolute error', 'Predicted minus observed, without sign', bar));
    }
    return [make('h2', { textContent: 'Image' }), make('div', { className: 'figures' }, ...figures, ...numbers)];
  }

  /** The metrics of one half, as a table or none. */
  #numbers(numbers, half) {
    const rows = numbers.filter((n) => n.half === half).map((n) => make('tr', {}, make('th', { textContent: n.name, title: n.title }), make('td', { textContent: n.value })));
    return rows.length ? [make('table', { className: 'numbers' }, make('tbody', {}, ...rows))] : [];
  }
}
