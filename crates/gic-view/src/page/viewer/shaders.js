// A point of the world [m] to the picture: rows of the camera (right, down, forward), focal lengths and principal point in pixels.
const PROJECTION = `#version 300 es
precision highp float; precision highp int; precision highp usampler2D; precision highp isampler2D;
uniform vec3 right, down, forward, eye; uniform vec2 focal, principal, viewport; uniform float near, far;
vec3 inCamera(vec3 p) { p -= eye; return vec3(dot(right, p), dot(down, p), dot(forward, p)); }
vec2 toPixel(vec3 c) { return focal * c.xy / c.z + principal; }
vec4 toClip(vec2 pixel, float z) {
  vec2 ndc = vec2(2. * pixel.x / viewport.x - 1., 1. - 2. * pixel.y / viewport.y);
  return vec4(ndc * z, (z * (far + near) - 2. * far * near) / (far - near), z);
}
vec4 projected(vec3 p) {
  vec3 c = inCamera(p);
  vec2 numerator = focal * c.xy + principal * c.z;
  vec2 ndc = vec2(2. * numerator.x / viewport.x - c.z, c.z - 2. * numerator.y / viewport.y);
  return vec4(ndc, (c.z * (far + near) - 2. * far * near) / (far - near), c.z);
}`;

// Where splat i is, and its colour. Mode 0: the video's colours, 1: stress, 2: speed, 3: bodies.
const SPLAT = `
uniform usampler2D staticTexture, particleTexture, speedTexture; uniform isampler2D normalTexture;
uniform vec3 low, size; uniform float maxOffset, maxScale; uniform int mode; uniform vec2 range;
uniform vec3 light[36]; uniform int bodyEnds[4]; uniform int hidden; uniform bool isLit; uniform vec3 up;
out vec4 color;
ivec2 cell(int i) { return ivec2(i & 2047, i >> 11); }
int short16(uint x) { return int(x << 16) >> 16; }
vec3 ramp(float t) {
  vec3 a = vec3(.16, .27, .66), b = vec3(.35, .70, .90), c = vec3(.98, .86, .38), d = vec3(.84, .15, .16);
  t = clamp(t, 0., 1.) * 3.;
  return t < 1. ? mix(a, b, t) : t < 2. ? mix(b, c, t - 1.) : mix(c, d, t - 2.);
}
struct Splat { vec3 centre; float scale; bool shown; };
Splat splat(int i) {
  uvec4 fixedPart = texelFetch(staticTexture, cell(i), 0);
  int carrier = int(fixedPart.x);
  uvec4 particle = texelFetch(particleTexture, cell(carrier), 0);
  vec3 offset = vec3(short16(fixedPart.y), short16(fixedPart.y >> 16), short16(fixedPart.z)) / 32767.;
  vec3 centre = low + size * vec3(particle.xyz) / 65535. + maxOffset * offset;
  float scale = maxScale * float(fixedPart.z >> 16) / 65535.;
  vec4 own = vec4((uvec4(fixedPart.w) >> uvec4(0, 8, 16, 24)) & 255u) / 255.;
  int body = i < bodyEnds[0] ? 0 : i < bodyEnds[1] ? 1 : i < bodyEnds[2] ? 2 : 3;
  vec3 n = vec3(texelFetch(normalTexture, cell(i), 0).xyz) / 127.;
  if (mode == 0 && isLit) {
    int at = 9 * body;
    color.rgb = own.rgb * (light[at] + light[at + 1] * n.x + light[at + 2] * n.y + light[at + 3] * n.z
      + light[at + 4] * n.x * n.y + light[at + 5] * n.y * n.z + light[at + 6] * n.z * n.x
      + light[at + 7] * (n.x * n.x - n.y * n.y) + light[at + 8] * (n.z * n.z - .5 * (n.x * n.x + n.y * n.y)));
  } else {
    float value = mode == 2 ? float(texelFetch(speedTexture, cell(carrier), 0).x) : float(particle.w);
    vec3 hues[4] = vec3[](vec3(.80, .58, .42), vec3(.42, .62, .80), vec3(.55, .75, .45), vec3(.75, .50, .72));
    vec3 base = mode == 0 ? own.rgb : mode == 3 ? hues[body] : ramp((value / 65535. - range.x) / max(range.y - range.x, 1e-9));
    vec3 lamp = normalize(up * 1.2 - right * .5 - forward * .7);
    color.rgb = base * (.62 + .42 * max(dot(n, lamp) / max(length(n), .2), 0.));
  }
  color.a = own.a;
  return Splat(centre, scale, (hidden >> body & 1) == 0);
}
const vec4 NOWHERE = vec4(2., 2., 2., 1.);`;

const SHADERS = {
  // Vertex 4 i + k is corner k of the i-th splat from afar. An isotropic Gaussian is an ellipse in the picture, longest away from the principal point; as wide as it is visible.
  splats: [`${PROJECTION}${SPLAT}
    uniform usampler2D orderTexture; out vec2 at;
    void main() {
      Splat s = splat(int(texelFetch(orderTexture, cell(gl_VertexID >> 2), 0).x));
      vec3 c = inCamera(s.centre);
      float visible = log(255. * color.a);
      if (!s.shown || c.z < near || visible <= 0.) { gl_Position = NOWHERE; return; }
      vec2 slope = c.xy / c.z;
      float along = dot(slope, slope), f = .5 * (focal.x + focal.y) * s.scale / c.z;
      vec2 axis = along > 1e-12 ? slope * inversesqrt(along) : vec2(1., 0.);
      vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1 & 1) * 2. - 1.;
      at = corner * sqrt(2. * visible);
      vec2 sigma = sqrt(vec2(f * f * (1. + along), f * f) + .3);
      gl_Position = toClip(toPixel(c) + at.x * sigma.x * axis + at.y * sigma.y * vec2(-axis.y, axis.x), c.z);
    }`,
  `#version 300 es
    precision mediump float; in vec2 at; in vec4 color; uniform float opacity; out vec4 result;
    void main() {
      float alpha = color.a * exp(-.5 * dot(at, at)) * opacity;
      if (alpha < 1. / 255.) discard;
      result = vec4(color.rgb * alpha, alpha);
    }`],
  points: [`${PROJECTION}${SPLAT}
    uniform float spacing;
    void main() {
      Splat s = splat(gl_VertexID);
      float z = dot(forward, s.centre - eye);
      gl_Position = s.shown && z > near ? projected(s.centre) : NOWHERE;
      gl_PointSize = max(1.5, focal.y * spacing / z);
    }`,
  `#version 300 es
    precision mediump float; in vec4 color; uniform float opacity; out vec4 result;
    void main() {
      vec2 q = 2. * gl_PointCoord - 1.;
      if (dot(q, q) > 1.) discard;
      result = vec4(color.rgb, 1.) * opacity;
    }`],
  // Shapes with normals, turned and moved by a pose.
  solids: [`${PROJECTION}
    in vec3 place, normal; uniform vec3 position; uniform vec4 rotation; out vec3 outward; out vec3 world;
    vec3 turn(vec3 v) { vec3 t = 2. * cross(rotation.xyz, v); return v + rotation.w * t + cross(rotation.xyz, t); }
    void main() { world = turn(place) + position; outward = turn(normal); gl_Position = projected(world); }`,
  `#version 300 es
    precision highp float; in vec3 outward, world; uniform vec3 eye, up, right, forward; out vec4 result;
    void main() {
      vec3 n = normalize(outward), lamp = normalize(up * 1.2 - right * .5 - forward * .7);
      float rim = 1. - abs(dot(n, normalize(eye - world)));
      result = vec4(vec3(.50, .55, .63) * (.55 + .45 * max(dot(n, lamp), 0.)) + .10 * rim * rim, 1.);
    }`],
  // A plane with lines that fade into the distance, and the shadows of what is above.
  planes: [`${PROJECTION}
    in vec2 corner; uniform vec3 middle, across, along; uniform float half_m; out vec2 at;
    void main() { at = corner * half_m; gl_Position = projected(middle + across * at.x + along * at.y); }`,
  `#version 300 es
    precision highp float; in vec2 at; uniform float half_m, tile, strength; uniform vec3 lines; uniform vec2 origin; out vec4 result;
    void main() {
      vec2 share = (at + origin) / tile, wide = fwidth(share);
      vec2 near = abs(fract(share - .5) - .5) / max(wide, 1e-6);
      float line = (1. - min(min(near.x, near.y), 1.)) * clamp(1. - .5 * max(wide.x, wide.y), 0., 1.);
      float fade = clamp(1.2 - 1.2 * length(at) / half_m, 0., 1.);
      float alpha = strength * fade * (.24 + .6 * line);
      result = vec4(lines * alpha, alpha);
    }`],
  // A soft dark spot below every so-many-th splat.
  shadows: [`${PROJECTION}${SPLAT}
    uniform int every; uniform vec3 middle, plane, across, along; uniform float spread; out vec2 at; out float dark;
    void main() {
      Splat s = splat((gl_VertexID >> 2) * every);
      float height = dot(plane, s.centre - middle);
      at = vec2(gl_VertexID & 1, gl_VertexID >> 1 & 1) * 2. - 1.;
      float radius = spread + .25 * max(height, 0.);
      dark = spread * spread / (radius * radius);
      vec3 foot = s.centre - plane * height + (across * at.x + along * at.y) * radius;
      gl_Position = s.shown && height > -spread ? projected(foot) : NOWHERE;
    }`,
  `#version 300 es
    precision mediump float; in vec2 at; in float dark; uniform float strength; out vec4 result;
    void main() { result = vec4(0., 0., 0., strength * dark * max(1. - dot(at, at), 0.)); }`],
  // A picture of the video behind everything, with the outside of the mask darkened as asked.
  picture: [`#version 300 es
    in vec2 corner; uniform vec4 frame; out vec2 at;
    void main() { at = corner * .5 + .5; gl_Position = vec4(mix(frame.xy, frame.zw, at), 1., 1.); at.y = 1. - at.y; }`,
  `#version 300 es
    precision mediump float; in vec2 at; uniform sampler2D picture, mask; uniform int shown; out vec4 result;
    void main() {
      float inside = texture(mask, at).r;
      vec3 video = texture(picture, at).rgb;
      result = vec4(shown == 1 ? video : shown == 2 ? mix(vec3(.08, .09, .11), vec3(.18, .80, .25), inside) : video * mix(.35, 1., inside), 1.);
    }`],
};
