// WebGL programs. Splats are projected as corf projects them: perspective Jacobian held inside 1.15 of the image, a pixel filter with
// compensated opacity, spherical harmonics in the direction from the eye, weights below 1/255 not drawn.

const SPLAT_VERTEX = `#version 300 es
precision highp float;
precision highp int;
precision highp sampler2D;
layout(location = 0) in uint gaussian;
uniform sampler2D geometry;
uniform sampler2D harmonics;
uniform mat3 rotation;
uniform vec3 translation;
uniform vec3 eye;
uniform vec2 focal;
uniform vec2 centre;
uniform vec2 size;
uniform vec4 limits;
uniform float near;
uniform float dilation;
uniform bool antialias;
uniform bool radio;
uniform int channels;
uniform int coefficients;
uniform int texels;
out vec2 offset;
flat out vec3 conic;
flat out vec4 tint;

const float LEAST_RATIO = 2.5e-5;

vec4 at(sampler2D data, int texel) {
  int width = textureSize(data, 0).x;
  return texelFetch(data, ivec2(texel % width, texel / width), 0);
}

vec3 colour(vec3 d) {
  float x = d.x, y = d.y, z = d.z;
  float basis[16] = float[16](
    0.2820948,
    -0.4886025 * y, 0.4886025 * z, -0.4886025 * x,
    1.0925484 * x * y, -1.0925484 * y * z, 0.31539157 * (2.0 * z * z - x * x - y * y), -1.0925484 * x * z, 0.5462742 * (x * x - y * y),
    -0.5900436 * y * (3.0 * x * x - y * y), 2.8906114 * x * y * z, -0.4570458 * y * (4.0 * z * z - x * x - y * y),
    0.37317634 * z * (2.0 * z * z - 3.0 * x * x - 3.0 * y * y), -0.4570458 * x * (4.0 * z * z - x * x - y * y),
    1.4453057 * z * (x * x - y * y), -0.5900436 * x * (x * x - 3.0 * y * y));
  int first = int(gaussian) * texels;
  vec3 sum = vec3(0.5);
  vec4 four = vec4(0.0);
  for (int k = 0; k < coefficients; k++) {
    for (int c = 0; c < channels; c++) {
      int i = k * channels + c;
      if (i % 4 == 0) four = at(harmonics, first + i / 4);
      sum[c] += four[i % 4] * basis[k];
    }
  }
  return max(sum, 0.0);
}

void main() {
  gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
  int first = int(gaussian) * 3;
  vec4 a = at(geometry, first), b = at(geometry, first + 1), c = at(geometry, first + 2);
  vec3 p = rotation * a.xyz + translation;
  if (!(p.z > near)) return;
  mat3 world = mat3(b.x, b.y, b.z, b.y, c.x, c.y, b.z, c.y, c.z);
  mat3 v = rotation * world * transpose(rotation);
  vec2 tangent = p.xy / p.z;
  vec2 held = clamp(tangent, limits.xy, limits.zw);
  vec2 scale = focal / p.z;
  vec3 j0 = vec3(scale.x, 0.0, -scale.x * held.x), j1 = vec3(0.0, scale.y, -scale.y * held.y);
  vec3 v0 = v * j0, v1 = v * j1;
  float xx = dot(j0, v0), xy = dot(j1, v0), yy = dot(j1, v1);
  float sxx = xx + dilation, syy = yy + dilation;
  float determinant = sxx * syy - xy * xy;
  if (!(determinant > 0.0)) return;
  float ratio = max((xx * yy - xy * xy) / determinant, LEAST_RATIO);
  float opacity = (radio ? b.w : a.w) * (antialias ? sqrt(ratio) : 1.0);
  float tau = log(max(255.0 * opacity, 1e-30));
  if (!(tau > 0.0)) return;
  vec2 mean = focal * tangent + centre;
  vec2 reach = sqrt(2.0 * tau * vec2(sxx, syy));
  if (any(lessThan(mean + reach, vec2(0.0))) || any(greaterThan(mean - reach, size))) return;
  // The corner of a box along the ellipse's own axes: most of an upright box around a slanting ellipse would be drawn for nothing.
  float middle = 0.5 * (sxx + syy), spread = length(vec2(0.5 * (sxx - syy), xy));
  float major = middle + spread, minor = max(determinant / major, 1e-6);
  vec2 axis = abs(xy) > 1e-6 * major ? normalize(vec2(xy, major - sxx)) : (sxx >= syy ? vec2(1.0, 0.0) : vec2(0.0, 1.0));
  vec2 corner = vec2(float(gl_VertexID & 1), float(gl_VertexID >> 1)) * 2.0 - 1.0;
  vec2 extent = sqrt(2.0 * tau * vec2(major, minor)) + 0.5;
  offset = corner.x * extent.x * axis + corner.y * extent.y * vec2(-axis.y, axis.x);
  conic = vec3(syy, -xy, sxx) / determinant;
  tint = vec4(colour(normalize(a.xyz - eye)), opacity);
  vec2 place = (mean + offset) / size * 2.0 - 1.0;
  gl_Position = vec4(place.x, -place.y, 0.0, 1.0);
}`;

const SPLAT_FRAGMENT = `#version 300 es
precision highp float;
in vec2 offset;
flat in vec3 conic;
flat in vec4 tint;
out vec4 drawn;
void main() {
  float power = -0.5 * (conic.x * offset.x * offset.x + 2.0 * conic.y * offset.x * offset.y + conic.z * offset.y * offset.y);
  float weight = tint.a * exp(min(power, 0.0));
  if (weight < 1.0 / 255.0) discard;
  weight = min(weight, 0.999);
  drawn = vec4(tint.rgb * weight, weight);
}`;

const RESOLVE_VERTEX = `#version 300 es
out vec2 place;
void main() {
  place = vec2(float(gl_VertexID & 1) * 2.0, float(gl_VertexID >> 1) * 2.0);
  gl_Position = vec4(place * 2.0 - 1.0, 0.0, 1.0);
}`;

const RESOLVE_FRAGMENT = `#version 300 es
precision highp float;
precision highp sampler2D;
in vec2 place;
uniform sampler2D picture;
uniform sampler2D ramp;
uniform bool levels;
out vec4 shown;
void main() {
  vec3 value = clamp(texture(picture, place).rgb, 0.0, 1.0);
  float last = float(textureSize(ramp, 0).x - 1);
  vec3 colour = texture(ramp, vec2((value.r * last + 0.5) / (last + 1.0), 0.5)).rgb;
  shown = vec4(levels ? colour : value, 1.0);
}`;

const POINT_VERTEX = `#version 300 es
precision highp float;
layout(location = 0) in vec3 position;
layout(location = 1) in vec4 shade;
uniform mat3 rotation;
uniform vec3 translation;
uniform vec2 focal;
uniform vec2 centre;
uniform vec2 size;
uniform float near;
out vec3 tint;
void main() {
  vec3 p = rotation * position + translation;
  tint = shade.rgb;
  vec2 place = (focal * p.xy / p.z + centre) / size * 2.0 - 1.0;
  gl_Position = p.z > near ? vec4(place.x, -place.y, 1.0 - 2.0 * near / p.z, 1.0) : vec4(2.0, 2.0, 2.0, 1.0);
  gl_PointSize = clamp(0.025 * focal.x / p.z, 2.0, 9.0);
}`;

const POINT_FRAGMENT = `#version 300 es
precision mediump float;
in vec3 tint;
out vec4 shown;
void main() {
  if (length(gl_PointCoord - 0.5) > 0.5) discard;
  shown = vec4(tint, 1.0);
}`;
