// A field that grows: asks the reconstruction how far it is, brings new Gaussians, and says when it has ended.

/** Least pause between two questions, and between tries where nobody answers, milliseconds. */
const POLL_MS = 500;
/** Most pause after a field that took long to bring. */
const MOST_PAUSE_MS = 2000;
/** Questions without an answer after which the program has ended. */
const MOST_FAILURES = 3;

const pause = (ms) => new Promise((done) => setTimeout(done, ms));

class Growth {
  #loaded = 0;
  #last = null;

  /**
   * @param scene The scene document.
   * @param source Where answers come from.
   * @param hooks field(buffer, layout): a new field; told(training keyframes that are done).
   */
  constructor(scene, source, hooks) {
    Object.assign(this, { scene, source, hooks, box: document.getElementById('growth') });
    this.box.hidden = false;
    this.box.append(this.text = make('span', { textContent: 'connecting …' }), make('div', {}, this.bar = make('i')));
  }

  /** Asks until the reconstruction has ended, or the program with it. A page that nobody sees asks for no field. */
  async follow() {
    for (let failures = 0; failures < MOST_FAILURES;) {
      const start = performance.now();
      try {
        const now = this.#last = await this.source.json(document.hidden && this.#loaded ? 'progress' : 'growth');
        failures = 0;
        if (now.version > this.#loaded) await this.#bring(now);
        this.#say(now);
        this.hooks.told(this.#keyframes(now));
        if (now.finished && this.#loaded >= now.version) return;
      } catch (error) {
        failures++;
        console.warn(error);
      }
      await pause(Math.min(MOST_PAUSE_MS, Math.max(POLL_MS, 2 * (performance.now() - start))));
    }
    this.#lost();
  }

  async #bring(now) {
    const { buffer, version } = await this.source.field();
    this.hooks.field(buffer, now.field);
    this.#loaded = version;
  }

  /** Training keyframes that are done. */
  #keyframes({ unit, done, total }) {
    const all = this.scene.keyframes.filter((k) => k.role === 'train').length;
    return unit === 'keyframes' ? Math.min(done, all) : done > 0 ? all : 0;
  }

  /** How far it is, in words. */
  #words(now) {
    const all = this.scene.keyframes.filter((k) => k.role === 'train').length, { unit, done, total } = now;
    if (unit !== 'keyframes') return `${unit.slice(0, -1)} ${grouped(done)} of ${grouped(total)}`;
    if (done < all) return `training keyframe ${done} of ${all}`;
    return `all ${all} training keyframes${done > all ? `, and round ${done - all} of ${total - all} after them` : ''}`;
  }

  #say(now) {
    const gaussians = now.gaussians === null ? '' : ` · ${grouped(now.gaussians)} Gaussians`;
    this.bar.style.width = `${100 * now.done / Math.max(1, now.total)}%`;
    this.text.textContent = now.finished ? `The reconstruction has ended: ${this.#words(now)}${gaussians}` : `${this.#words(now)}${gaussians}`;
    this.box.classList.toggle('ended', now.finished);
    this.box.title = now.finished ? 'What is shown is its result; corf view shows its predictions beside what was observed'
      : now.version === 0 ? 'Nothing is drawn before the first keyframes are done'
        : 'Training keyframes that are done; what is drawn follows within a second';
  }

  #lost() {
    const heard = this.#last ? `: ${this.#words(this.#last)} was the last that it said` : '';
    const shown = this.#loaded ? 'What was brought by then stays here.' : 'It brought nothing to show.';
    this.text.textContent = `The program has ended${heard}. ${shown}`;
    this.box.title = 'It was interrupted, or ended sooner than this page could ask: where the run is finished, corf view shows it';
    this.box.classList.add('ended', 'lost');
  }
}
