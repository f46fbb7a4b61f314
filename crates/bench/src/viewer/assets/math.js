// Poses, cameras and angles. The world has z up; a camera has x right, y down and z forward (OpenCV); lengths are metres.

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const along = (p, d, s) => [p[0] + d[0] * s, p[1] + d[1] * s, p[2] + d[2] * s];
const minus = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const clamp = (v, low, high) => Math.min(high, Math.max(low, v));
const degrees = (radians) => radians * 180 / Math.PI;
const radians = (degrees) => degrees * Math.PI / 180;

/** The axes of a camera that stands level: right, down and forward in the world. */
function levelAxes(yaw, pitch) {
  const forward = [Math.cos(pitch) * Math.cos(yaw), Math.cos(pitch) * Math.sin(yaw), Math.sin(pitch)];
  const right = [Math.sin(yaw), -Math.cos(yaw), 0];
  return { right, down: cross(forward, right), forward };
}

/** The axes of a view {eye, yaw, pitch, roll}. */
function axesOf(view) {
  const { right, down, forward } = levelAxes(view.yaw, view.pitch);
  const c = Math.cos(view.roll), s = Math.sin(view.roll);
  return {
    right: along(right.map((v) => v * c), down, s),
    down: along(down.map((v) => v * c), right, -s),
    forward,
  };
}

/** The view of a pose given as three rows of world_from_camera. */
function viewOfPose(rows) {
  const column = (k) => [rows[0][k], rows[1][k], rows[2][k]];
  const right = column(0), forward = column(2);
  const level = Math.hypot(forward[0], forward[1]);
  const pitch = Math.atan2(forward[2], level);
  // Straight up or down there is no heading: the camera's right says it.
  const yaw = level > 1e-6 ? Math.atan2(forward[1], forward[0]) : Math.atan2(right[0], -right[1]);
  const flat = levelAxes(yaw, pitch);
  return { eye: column(3), yaw, pitch, roll: Math.atan2(dot(right, flat.down), dot(right, flat.right)) };
}

/** A point of the world in the axes of a camera. */
function toCamera(axes, eye, point) {
  const d = minus(point, eye);
  return [dot(axes.right, d), dot(axes.down, d), dot(axes.forward, d)];
}

/** A pinhole camera on another number of pixels, the same directions. */
function scaledCamera(camera, width, height) {
  const x = width / camera.width, y = height / camera.height;
  return { width, height, fx: camera.fx * x, fy: camera.fy * y, cx: camera.cx * x, cy: camera.cy * y };
}

/** A camera of square pixels that holds all of a picture of `shape`, whose width spans `fov` degrees. */
function cameraOfView(width, height, fov, shape) {
  const f = Math.min(width / shape.width, height / shape.height) * shape.width / (2 * Math.tan(radians(fov) / 2));
  return { width, height, fx: f, fy: f, cx: width / 2, cy: height / 2 };
}

/** The horizontal field of view of a camera, degrees. */
function horizontalFov(camera) {
  return degrees(2 * Math.atan(camera.width / (2 * camera.fx)));
}

/** Azimuth (positive to the left) and elevation (positive up) of a pixel's direction seen from its camera, degrees. */
function anglesOfPixel(camera, u, v) {
  const x = (u - camera.cx) / camera.fx, y = (v - camera.cy) / camera.fy;
  return { azimuth: degrees(Math.atan2(-x, 1)), elevation: degrees(Math.atan2(-y, Math.hypot(x, 1))) };
}

/** A whole number with its thousands apart. */
const grouped = (count) => String(count).replace(/\B(?=(\d{3})+$)/g, '\u202f');

/** The bytes of a base64 text. */
function bytesOf(base64) {
  const text = atob(base64);
  const bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  return bytes;
}
