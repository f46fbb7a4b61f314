// The camera in a person's hands: mouse, keys and touch change the view {eye, yaw, pitch, roll} and the distance of what it turns around.

/** Closest that the point turned around comes, metres. */
const LEAST_DISTANCE = 0.4;
/** Speed of flight, metres a second. */
const SPEED = 1.6;
/** Farthest a press may wander and still be a click, pixels: of a mouse, and of a finger, which is broad and never quite still. */
const CLICK_PX = 5;
const TAP_PX = 14;

class Controls {
  /**
   * @param element What is dragged on.
   * @param view The view, which is changed in place.
   * @param hooks changed(), clicked(x, y, whether by a finger), hovered(x, y), focal(): pixels of the page a radian spans.
   */
  constructor(element, view, hooks) {
    Object.assign(this, { element, view, hooks, distance: 2.5, around: true, keys: new Set(), pointers: new Map(), last: 0 });
    element.addEventListener('pointerdown', (e) => this.#down(e));
    element.addEventListener('pointermove', (e) => this.#move(e));
    for (const end of ['pointerup', 'pointercancel']) element.addEventListener(end, (e) => this.#up(e));
    // A finger leaves with every touch; what it has pointed at stays.
    element.addEventListener('pointerleave', (e) => e.pointerType === 'mouse' && hooks.hovered(-1, -1));
    element.addEventListener('contextmenu', (e) => e.preventDefault());
    element.addEventListener('wheel', (e) => this.#wheel(e), { passive: false });
    window.addEventListener('keydown', (e) => this.#key(e, true));
    window.addEventListener('keyup', (e) => this.#key(e, false));
    window.addEventListener('blur', () => this.keys.clear());
  }

  /** Whether somebody is moving the camera. */
  get moving() {
    return this.pointers.size > 0 || this.keys.size > 0;
  }

  #down(e) {
    this.element.setPointerCapture(e.pointerId);
    this.pointers.set(e.pointerId, { x: e.offsetX, y: e.offsetY, from: [e.offsetX, e.offsetY], still: this.pointers.size === 0 });
    if (this.pointers.size > 1) for (const p of this.pointers.values()) p.still = false;
  }

  #move(e) {
    const pointer = this.pointers.get(e.pointerId);
    if (!pointer) return this.hooks.hovered(e.offsetX, e.offsetY);
    const dx = e.offsetX - pointer.x, dy = e.offsetY - pointer.y;
    const most = e.pointerType === 'touch' ? TAP_PX : CLICK_PX;
    if (Math.hypot(e.offsetX - pointer.from[0], e.offsetY - pointer.from[1]) > most) pointer.still = false;
    if (pointer.still) return;
    const before = this.#spread();
    [pointer.x, pointer.y] = [e.offsetX, e.offsetY];
    if (this.pointers.size > 1) {
      // Each of two fingers moves their middle by half.
      const share = 1 / this.pointers.size;
      this.pan(dx * share, dy * share);
      if (before > 0) this.dolly(Math.log(this.#spread() / before));
    } else if (e.buttons & 6 || e.shiftKey) this.pan(dx, dy);
    else this.turn(dx, dy, this.around !== (e.ctrlKey || e.metaKey));
  }

  #spread() {
    const [a, b] = this.pointers.values();
    return b ? Math.hypot(a.x - b.x, a.y - b.y) : 0;
  }

  #up(e) {
    const pointer = this.pointers.get(e.pointerId);
    this.pointers.delete(e.pointerId);
    if (pointer?.still && e.type === 'pointerup' && e.button === 0) {
      if (e.pointerType !== 'mouse') this.hooks.hovered(e.offsetX, e.offsetY);
      this.hooks.clicked(e.offsetX, e.offsetY, e.pointerType === 'touch');
    }
    this.hooks.changed();
  }

  #wheel(e) {
    e.preventDefault();
    const lines = e.deltaMode === 1 ? 16 : 1;
    this.dolly(clamp(-e.deltaY * lines * 0.0015, -0.5, 0.5));
  }

  #key(e, down) {
    const key = e.key.toLowerCase();
    if (!'wasdqe'.includes(key) || key.length !== 1) return;
    if (down && (e.ctrlKey || e.metaKey || e.altKey || e.target.closest?.('input, select, textarea, dialog'))) return;
    if (!down) this.keys.delete(key);
    else if (!this.keys.has(key)) {
      if (this.keys.size === 0) this.last = performance.now();
      this.keys.add(key);
      this.fast = e.shiftKey;
      this.hooks.changed();
    }
  }

  /** Flies on while keys are held; true if it moved. */
  fly(now) {
    if (this.keys.size === 0) return false;
    const step = SPEED * (this.fast ? 3 : 1) * Math.min(0.1, (now - this.last) / 1000);
    this.last = now;
    const { right, forward } = axesOf(this.view);
    const sign = (plus, minus) => (this.keys.has(plus) ? 1 : 0) - (this.keys.has(minus) ? 1 : 0);
    let eye = along(this.view.eye, forward, step * sign('w', 's'));
    eye = along(eye, right, step * sign('d', 'a'));
    this.view.eye = along(eye, [0, 0, 1], step * sign('e', 'q'));
    return true;
  }

  /** Turns by a drag: around the point ahead, or (`around` false) where the camera stands. */
  turn(dx, dy, around) {
    const view = this.view;
    const pivot = along(view.eye, axesOf(view).forward, this.distance);
    const sense = around ? -1 : 1, angle = around ? 0.006 : 1 / this.hooks.focal();
    view.yaw += sense * dx * angle;
    view.pitch = clamp(view.pitch + sense * dy * angle, -1.55, 1.55);
    if (around) view.eye = along(pivot, axesOf(view).forward, -this.distance);
    this.hooks.changed();
  }

  /** Moves sideways, so that what lies at the distance of the point ahead follows the hand. */
  pan(dx, dy) {
    const { right, down } = axesOf(this.view), scale = this.distance / this.hooks.focal();
    this.view.eye = along(along(this.view.eye, right, -dx * scale), down, -dy * scale);
    this.hooks.changed();
  }

  /** Moves ahead by a share (logarithmic) of the distance; what is turned around is pushed ahead once it is close. */
  dolly(by) {
    const step = this.distance * (1 - Math.exp(-by));
    this.view.eye = along(this.view.eye, axesOf(this.view).forward, step);
    this.distance = Math.max(LEAST_DISTANCE, this.distance - step);
    this.hooks.changed();
  }
}
