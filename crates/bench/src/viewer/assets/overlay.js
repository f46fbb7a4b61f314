// Lines over the picture: trajectory, keyframes, transmitter, and the frame of the spectrum. They are never hidden by what they lie behind.

const INK = { path: '#8fa3bf', train: '#7fb2ff', test: '#ffb454', other: '#8b93a1', chosen: '#ffffff', transmitter: '#ff5d73' };
/** Lines end this far in front of the eye, metres. */
const NEAR_LINE = 0.03;
/** Room around a pyramid in which a click or a finger still hits it, and the width from which on its inside is none, pixels. */
const GRACE_PX = 6;
const FINGER_PX = 16;
const LARGE_PX = 120;

class Overlay {
  /** @param scene The scene document; frusta are sized by the distance between keyframes. */
  constructor(canvas, scene) {
    Object.assign(this, { canvas, scene, ink: canvas.getContext('2d'), hovered: -1, grown: 0 });
    // Of a reconstruction at work: which of its training keyframes each is.
    let trained = 0;
    this.turn = scene.keyframes.map((k) => (k.role === 'train' ? trained++ : -1));
    const eyes = scene.keyframes.map((k) => [k.pose[0][3], k.pose[1][3], k.pose[2][3]]);
    const steps = eyes.slice(1).map((e, i) => Math.hypot(...minus(e, eyes[i]))).filter((s) => s > 0).sort((a, b) => a - b);
    this.size = clamp(0.4 * (steps[steps.length >> 1] ?? 0.4), 0.06, 0.3);
    this.eyes = eyes;
    const shape = scene.optical_camera;
    const corner = (u, v) => [(u - shape.cx) / shape.fx, (v - shape.cy) / shape.fy];
    const corners = [corner(0, 0), corner(shape.width, 0), corner(shape.width, shape.height), corner(0, shape.height)];
    this.frusta = scene.keyframes.map(({ pose }, i) => corners.map(([x, y]) => {
      const axis = (r) => pose[r][0] * x + pose[r][1] * y + pose[r][2];
      return along(eyes[i], [axis(0), axis(1), axis(2)], this.size);
    }));
  }

  /** Matches the canvas to the page's pixels and wipes it. */
  clear(width, height, ratio) {
    const { canvas, ink } = this;
    if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
    ink.setTransform(1, 0, 0, 1, 0, 0);
    ink.clearRect(0, 0, width, height);
    ink.setTransform(ratio, 0, 0, ratio, 0, 0);
  }

  #project(camera, p) {
    return [camera.fx * p[0] / p[2] + camera.cx, camera.fy * p[1] / p[2] + camera.cy];
  }

  /** A line of the world, cut where it passes the eye. */
  #line(axes, eye, camera, from, to) {
    let a = toCamera(axes, eye, from), b = toCamera(axes, eye, to);
    if (a[2] < NEAR_LINE && b[2] < NEAR_LINE) return;
    if (a[2] > b[2]) [a, b] = [b, a];
    if (a[2] < NEAR_LINE) a = along(a, minus(b, a), (NEAR_LINE - a[2]) / (b[2] - a[2]));
    this.ink.moveTo(...this.#project(camera, a));
    this.ink.lineTo(...this.#project(camera, b));
  }

  /**
   * Draws over one view.
   *
   * @param camera The view's camera in pixels of the page.
   * @param place {x, y, width, height}, pixels of the page.
   * @param frame Camera whose frame is outlined, or null.
   */
  draw(axes, eye, camera, place, chosen, frame) {
    const { ink, scene } = this;
    ink.save();
    ink.beginPath();
    ink.rect(place.x, place.y, place.width, place.height);
    ink.clip();
    ink.translate(place.x, place.y);
    ink.lineJoin = 'round';
    ink.lineWidth = 1.5;
    ink.strokeStyle = INK.path;
    ink.globalAlpha = 0.7;
    ink.beginPath();
    for (let i = 1; i < this.eyes.length; i++) this.#line(axes, eye, camera, this.eyes[i - 1], this.eyes[i]);
    ink.stroke();
    for (let i = 0; i < this.eyes.length; i++) {
      // From where it stands a keyframe's own lines would cross the whole picture, and those close by much of it.
      const distance = Math.hypot(...minus(this.eyes[i], eye)) / this.size;
      if (distance < 1) continue;
      const marked = i === chosen || i === this.hovered;
      const ahead = scene.growing && this.turn[i] >= this.grown ? 0.3 : 1;
      ink.globalAlpha = marked ? 1 : ahead * clamp((distance - 1) / 8, 0.1, 0.85);
      ink.lineWidth = marked ? 2 : 1;
      ink.strokeStyle = i === chosen ? INK.chosen : INK[scene.keyframes[i].role] ?? INK.other;
      ink.beginPath();
      const corners = this.frusta[i];
      for (let k = 0; k < 4; k++) {
        this.#line(axes, eye, camera, this.eyes[i], corners[k]);
        this.#line(axes, eye, camera, corners[k], corners[(k + 1) % 4]);
      }
      ink.stroke();
    }
    ink.globalAlpha = 1;
    if (scene.transmitter) this.#transmitter(axes, eye, camera);
    if (frame) this.#frame(camera, frame);
    if (this.hovered >= 0) this.#name(axes, eye, camera, this.hovered);
    ink.restore();
  }

  #transmitter(axes, eye, camera) {
    const p = toCamera(axes, eye, this.scene.transmitter);
    if (p[2] < NEAR_LINE) return;
    const [u, v] = this.#project(camera, p), r = clamp(0.12 * camera.fx / p[2], 5, 12), { ink } = this;
    ink.fillStyle = INK.transmitter;
    ink.strokeStyle = '#14161a';
    ink.lineWidth = 1.5;
    ink.beginPath();
    ink.moveTo(u, v - r);
    ink.lineTo(u + r, v);
    ink.lineTo(u, v + r);
    ink.lineTo(u - r, v);
    ink.closePath();
    ink.fill();
    ink.stroke();
    this.#label('transmitter', u + r + 5, v);
  }

  #frame(camera, frame) {
    const { ink } = this;
    const x = (u) => camera.cx + camera.fx * (u - frame.cx) / frame.fx, y = (v) => camera.cy + camera.fy * (v - frame.cy) / frame.fy;
    const [left, right, top, bottom] = [x(0), x(frame.width), y(0), y(frame.height)];
    ink.strokeStyle = '#ffffffa0';
    ink.lineWidth = 1;
    ink.setLineDash([5, 4]);
    ink.strokeRect(left, top, right - left, bottom - top);
    ink.setLineDash([]);
  }

  #name(axes, eye, camera, i) {
    const p = toCamera(axes, eye, this.eyes[i]);
    if (p[2] < NEAR_LINE) return;
    const [u, v] = this.#project(camera, p);
    const role = { train: 'trained on', test: 'test' }[this.scene.keyframes[i].role];
    this.#label(`keyframe ${i + 1}${role ? `, ${role}` : ''}`, u + 12, v);
  }

  #label(text, x, y) {
    const { ink } = this;
    ink.font = '12px system-ui, sans-serif';
    ink.textBaseline = 'middle';
    ink.lineWidth = 3;
    ink.strokeStyle = '#14161ac0';
    ink.strokeText(text, x, y);
    ink.fillStyle = '#ffffff';
    ink.fillText(text, x, y);
  }

  /** The keyframe drawn at a place of a view, the nearest to the eye of several; -1 if there is none. */
  hit(axes, eye, camera, x, y, grace = GRACE_PX) {
    let best = -1, bestDepth = Infinity;
    for (let i = 0; i < this.eyes.length; i++) {
      if (Math.hypot(...minus(this.eyes[i], eye)) < this.size) continue;
      const corners = [this.eyes[i], ...this.frusta[i]].map((p) => toCamera(axes, eye, p));
      if (corners.some((p) => p[2] < NEAR_LINE)) continue;
      const at = corners.map((p) => this.#project(camera, p));
      const [left, right] = [Math.min(...at.map((p) => p[0])), Math.max(...at.map((p) => p[0]))];
      const [top, bottom] = [Math.min(...at.map((p) => p[1])), Math.max(...at.map((p) => p[1]))];
      const inside = x > left - grace && x < right + grace && y > top - grace && y < bottom + grace;
      // One that fills the view is hit at its tip alone.
      const tip = Math.hypot(x - at[0][0], y - at[0][1]) < 2 * grace;
      if ((tip || (inside && right - left < LARGE_PX)) && corners[0][2] < bestDepth) [best, bestDepth] = [i, corners[0][2]];
    }
    return best;
  }
}
