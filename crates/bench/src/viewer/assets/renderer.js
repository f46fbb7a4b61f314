// Draws the field, or the points of a data set, from any pose: WebGL 2, no library.

/** Texels a row of the data textures; every device has at least as many. */
const TEXTURE_WIDTH = 2048;
/** Share of the image by which corf holds directions inside its projection beyond the border. */
const BORDER = 0.15;
/** Nearest point that is drawn, metres. */
const NEAR_POINT = 0.05;

function program(gl, vertex, fragment) {
  const made = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    gl.attachShader(made, shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS) && !gl.isContextLost()) throw new Error(gl.getShaderInfoLog(shader));
  }
  gl.linkProgram(made);
  if (!gl.getProgramParameter(made, gl.LINK_STATUS) && !gl.isContextLost()) throw new Error(gl.getProgramInfoLog(made));
  const places = {};
  for (let i = 0; i < gl.getProgramParameter(made, gl.ACTIVE_UNIFORMS); i++) {
    const { name } = gl.getActiveUniform(made, i);
    places[name] = gl.getUniformLocation(made, name);
  }
  return { made, places };
}

/** A texture of numbers, `TEXTURE_WIDTH` texels a row. */
function dataTexture(gl, internal, type, values) {
  const rows = Math.max(1, Math.ceil(values.length / 4 / TEXTURE_WIDTH));
  const most = gl.getParameter(gl.MAX_TEXTURE_SIZE);
  if (rows > most) throw new Error('this field has more Gaussians than this graphics device can hold');
  const padded = new values.constructor(rows * TEXTURE_WIDTH * 4);
  padded.set(values);
  const texture = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, texture);
  gl.texImage2D(gl.TEXTURE_2D, 0, internal, TEXTURE_WIDTH, rows, 0, gl.RGBA, type, padded);
  for (const what of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, what, gl.NEAREST);
  return texture;
}

/** A picture that is drawn into before it is shown: halves of floats where the device blends them, bytes elsewhere. */
class Target {
  constructor(gl, internal) {
    this.gl = gl;
    this.internal = internal;
    this.texture = gl.createTexture();
    this.frame = gl.createFramebuffer();
    this.width = this.height = 0;
  }
  resize(width, height) {
    const gl = this.gl;
    if (this.width === width && this.height === height) return;
    [this.width, this.height] = [width, height];
    gl.bindTexture(gl.TEXTURE_2D, this.texture);
    const type = this.internal === gl.RGBA16F ? gl.HALF_FLOAT : gl.UNSIGNED_BYTE;
    gl.texImage2D(gl.TEXTURE_2D, 0, this.internal, width, height, 0, gl.RGBA, type, null);
    for (const what of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, what, gl.CLAMP_TO_EDGE);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.frame);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, this.texture, 0);
  }
}

class Renderer {
  #gl;
  /** What is drawn, and what takes its place once it is in order. */
  #splats = null;
  #next = null;
  #row = null;
  #points = {};
  #ramp;
  #targets;

  /** `drawn` is called whenever a new depth order asks for another picture. */
  constructor(canvas, scene, drawn) {
    const gl = canvas.getContext('webgl2', { alpha: false, antialias: false, preserveDrawingBuffer: true, powerPreference: 'high-performance' });
    if (!gl) throw new Error('this browser offers no WebGL 2, which drawing needs; another browser, or its hardware acceleration, may');
    this.#gl = gl;
    this.drawn = drawn;
    const halves = gl.getExtension('EXT_color_buffer_float') || gl.getExtension('EXT_color_buffer_half_float');
    this.#targets = { optical: new Target(gl, halves ? gl.RGBA16F : gl.RGBA8), rf: new Target(gl, halves ? gl.RGBA16F : gl.RGBA8) };
    this.splat = program(gl, SPLAT_VERTEX, SPLAT_FRAGMENT);
    this.resolve = program(gl, RESOLVE_VERTEX, RESOLVE_FRAGMENT);
    this.pointProgram = program(gl, POINT_VERTEX, POINT_FRAGMENT);
    this.empty = gl.createVertexArray();
    const ramp = new Uint8Array(scene.ramps.jet.flatMap(([r, g, b]) => [r, g, b, 255]));
    this.#ramp = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, this.#ramp);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, ramp.length / 4, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, ramp);
    for (const what of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, what, gl.LINEAR);
    for (const what of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, what, gl.CLAMP_TO_EDGE);
  }

  /**
   * Takes the Gaussians of a field: 12 floats each, then the harmonics of light, then those of radio, as halves. Those that are drawn already stay
   * until these are in order.
   */
  loadField(buffer, layout) {
    const gl = this.#gl, next = this.#upload(buffer, layout);
    next.sorter = new DepthOrder(next.position, layout.near_m, (sorted, row) => {
      gl.bindBuffer(gl.ARRAY_BUFFER, next.order);
      gl.bufferSubData(gl.ARRAY_BUFFER, 0, sorted);
      next.count = sorted.length;
      next.row = row.join();
      if (this.#next === next) {
        this.#release(this.#splats);
        [this.#splats, this.#next] = [next, null];
      }
      this.drawn();
    });
    this.#release(this.#next);
    this.#next = next;
    if (this.#row) next.sorter.request(this.#row);
  }

  #upload(buffer, layout) {
    const gl = this.#gl, halves = ['optical', 'rf'].filter((half) => layout[half]);
    // Bytes say how many there are: a field that grows may have gone on since its layout was told.
    const each = 48 + halves.reduce((sum, half) => sum + 8 * layout[half].texels, 0), total = buffer.byteLength / each;
    const geometry = new Float32Array(buffer, 0, 12 * total);
    const position = new Float32Array(3 * total);
    for (let i = 0; i < total; i++) position.set(geometry.subarray(12 * i, 12 * i + 3), 3 * i);
    let at = geometry.byteLength;
    const harmonics = {};
    for (const half of halves) {
      const values = new Uint16Array(buffer, at, 4 * layout[half].texels * total);
      at += values.byteLength;
      harmonics[half] = dataTexture(gl, gl.RGBA16F, gl.HALF_FLOAT, values);
    }
    const array = gl.createVertexArray();
    gl.bindVertexArray(array);
    const order = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, order);
    gl.bufferData(gl.ARRAY_BUFFER, 4 * total, gl.DYNAMIC_DRAW);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribIPointer(0, 1, gl.UNSIGNED_INT, 0, 0);
    gl.vertexAttribDivisor(0, 1);
    gl.bindVertexArray(null);
    return { layout, geometry: dataTexture(gl, gl.RGBA32F, gl.FLOAT, geometry), harmonics, array, order, count: 0, row: '', position };
  }

  /** Gives back what the graphics device holds of Gaussians that are drawn no more. */
  #release(splats) {
    if (!splats) return;
    const gl = this.#gl;
    splats.sorter.close();
    for (const texture of [splats.geometry, ...Object.values(splats.harmonics)]) gl.deleteTexture(texture);
    gl.deleteBuffer(splats.order);
    gl.deleteVertexArray(splats.array);
  }

  /** Takes the points of a data set: x, y, z as floats and a colour as bytes. */
  loadPoints(half, buffer) {
    const gl = this.#gl;
    const array = gl.createVertexArray();
    gl.bindVertexArray(array);
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, buffer, gl.STATIC_DRAW);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 16, 0);
    gl.enableVertexAttribArray(1);
    gl.vertexAttribPointer(1, 4, gl.UNSIGNED_BYTE, true, 16, 12);
    gl.bindVertexArray(null);
    const values = new Float32Array(buffer), position = [];
    for (let i = 0; i < values.length; i += 4) position.push(values[i], values[i + 1], values[i + 2]);
    this.#points[half] = { array, count: buffer.byteLength / 16, position };
  }

  /** Middles of the Gaussians, or the points: what can be turned around. */
  get positions() {
    return (this.#splats ?? this.#next)?.position ?? this.#points.optical?.position ?? this.#points.rf?.position ?? [];
  }

  /** Whether half a field ('optical', 'rf') can be drawn. */
  has(half) {
    return Boolean((this.#splats ?? this.#next)?.harmonics[half] || this.#points[half]);
  }

  /** Asks for the depth order of a view, unless it is at hand; true if it is. */
  order(axes, eye) {
    const row = this.#row = [...axes.forward, -dot(axes.forward, eye)];
    this.#next?.sorter.request(row);
    if (!this.#splats) return !this.#next;
    if (row.join() === this.#splats.row) return true;
    this.#splats.sorter.request(row);
    return false;
  }

  /** Clears the canvas to the colour of the page around the views. */
  clear(width, height) {
    const gl = this.#gl;
    if (gl.canvas.width !== width || gl.canvas.height !== height) [gl.canvas.width, gl.canvas.height] = [width, height];
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.disable(gl.SCISSOR_TEST);
    gl.clearColor(0.055, 0.063, 0.075, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
  }

  /**
   * Draws one view.
   *
   * @param half 'optical' or 'rf'.
   * @param axes, eye The pose.
   * @param camera The pinhole camera whose pixels are drawn.
   * @param place {x, y, width, height} on the canvas, device pixels from its top left.
   * @param crisp Whether the camera's pixels are shown as they are where the place has more.
   */
  draw(half, axes, eye, camera, place, crisp) {
    if (this.#splats?.harmonics[half]) this.#drawSplats(half, axes, eye, camera, place, crisp);
    else if (this.#points[half]) this.#drawPoints(half, axes, eye, scaledCamera(camera, place.width, place.height), place);
  }

  #pose({ places }, axes, eye, camera) {
    const gl = this.#gl, rows = [axes.right, axes.down, axes.forward];
    // Columns of camera_from_world.
    gl.uniformMatrix3fv(places.rotation, false, [0, 1, 2].flatMap((k) => rows.map((row) => row[k])));
    gl.uniform3fv(places.translation, rows.map((row) => -dot(row, eye)));
    gl.uniform2f(places.focal, camera.fx, camera.fy);
    gl.uniform2f(places.centre, camera.cx, camera.cy);
    gl.uniform2f(places.size, camera.width, camera.height);
  }

  #drawSplats(half, axes, eye, camera, place, crisp) {
    const gl = this.#gl, splats = this.#splats, field = splats.layout, { places } = this.splat;
    const appearance = field[half], target = this.#targets[half];
    target.resize(camera.width, camera.height);
    gl.bindFramebuffer(gl.FRAMEBUFFER, target.frame);
    gl.viewport(0, 0, camera.width, camera.height);
    gl.disable(gl.DEPTH_TEST);
    gl.clearColor(...appearance.background, 1);
    gl.clear(gl.COLOR_BUFFER_BIT);
    gl.useProgram(this.splat.made);
    this.#pose(this.splat, axes, eye, camera);
    gl.uniform3fv(places.eye, eye);
    const limit = (size, f, c) => [(-BORDER * size - c) / f, ((1 + BORDER) * size - c) / f];
    const [left, right] = limit(camera.width, camera.fx, camera.cx), [top, bottom] = limit(camera.height, camera.fy, camera.cy);
    gl.uniform4f(places.limits, left, top, right, bottom);
    gl.uniform1f(places.near, field.near_m);
    gl.uniform1f(places.dilation, field.dilation_px2);
    gl.uniform1i(places.antialias, field.compensated ? 1 : 0);
    gl.uniform1i(places.radio, half === 'rf' ? 1 : 0);
    gl.uniform1i(places.channels, appearance.channels);
    gl.uniform1i(places.coefficients, appearance.coefficients);
    gl.uniform1i(places.texels, appearance.texels);
    this.#texture(1, splats.harmonics[half], places.harmonics);
    this.#texture(0, splats.geometry, places.geometry);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    gl.bindVertexArray(splats.array);
    gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, splats.count);
    gl.disable(gl.BLEND);
    // Onto the canvas.
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    this.#viewport(place);
    gl.useProgram(this.resolve.made);
    this.#texture(1, this.#ramp, this.resolve.places.ramp);
    this.#texture(0, target.texture, this.resolve.places.picture);
    for (const what of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, what, crisp ? gl.NEAREST : gl.LINEAR);
    gl.uniform1i(this.resolve.places.levels, appearance.channels === 1 ? 1 : 0);
    gl.bindVertexArray(this.empty);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.bindVertexArray(null);
  }

  #drawPoints(half, axes, eye, camera, place) {
    const gl = this.#gl, points = this.#points[half];
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    this.#viewport(place);
    gl.enable(gl.SCISSOR_TEST);
    gl.scissor(place.x, gl.canvas.height - place.y - place.height, place.width, place.height);
    gl.enable(gl.DEPTH_TEST);
    gl.useProgram(this.pointProgram.made);
    this.#pose(this.pointProgram, axes, eye, camera);
    gl.uniform1f(this.pointProgram.places.near, NEAR_POINT);
    gl.bindVertexArray(points.array);
    gl.drawArrays(gl.POINTS, 0, points.count);
    gl.bindVertexArray(null);
    gl.disable(gl.DEPTH_TEST);
    gl.disable(gl.SCISSOR_TEST);
  }

  #viewport({ x, y, width, height }) {
    this.#gl.viewport(x, this.#gl.canvas.height - y - height, width, height);
  }

  /** Binds a texture to a unit, which stays the active one: unit 0 comes last. */
  #texture(unit, texture, place) {
    const gl = this.#gl;
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.uniform1i(place, unit);
  }

  /** The picture of half a field as it was last drawn, at one of its pixels (from the top left): three numbers, or null. */
  pixel(half, x, y) {
    const gl = this.#gl, target = this.#targets[half];
    if (!this.#splats?.harmonics[half] || !(x >= 0 && y >= 0 && x < target.width && y < target.height)) return null;
    gl.bindFramebuffer(gl.FRAMEBUFFER, target.frame);
    const floats = target.internal === gl.RGBA16F, out = floats ? new Float32Array(4) : new Uint8Array(4);
    gl.readPixels(Math.floor(x), target.height - 1 - Math.floor(y), 1, 1, gl.RGBA, floats ? gl.FLOAT : gl.UNSIGNED_BYTE, out);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    return [out[0], out[1], out[2]].map((v) => (floats ? v : v / 255));
  }

  /** The size of the picture of half a field as it was last drawn. */
  size(half) {
    return this.#targets[half];
  }
}
