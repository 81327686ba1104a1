"use strict";
const head = JSON.parse(document.getElementById("head").textContent);
const bytes = Uint8Array.from(atob(document.getElementById("data").textContent), (c) => c.charCodeAt(0));
const canvas = document.getElementById("canvas");
const gl = canvas.getContext("webgl", { antialias: true, preserveDrawingBuffer: true });
const slider = document.getElementById("frame");
const mode = document.getElementById("mode");

// A point takes eleven bytes per frame: position 3 x u16, colour 3 x u8, stress u8, speed u8 (and each list one after the other).
const { points, frames } = head;
const perFrame = 11 * points;
function list(frame) {
  const at = frame * perFrame;
  return {
    position: new Uint16Array(bytes.slice(at, at + 6 * points).buffer),
    color: bytes.subarray(at + 6 * points, at + 9 * points),
    value: [bytes.subarray(at + 9 * points, at + 10 * points), bytes.subarray(at + 10 * points, at + 11 * points)],
  };
}

function program(vertex, fragment) {
  const made = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
    gl.attachShader(made, shader);
  }
  gl.linkProgram(made);
  if (!gl.getProgramParameter(made, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(made));
  return made;
}

const balls = program(
  `attribute vec3 position; attribute vec3 color; attribute float value;
   uniform mat4 view; uniform vec3 low, size; uniform float radius, focal, aspect; uniform mediump int mode;
   varying vec3 tint;
   vec3 ramp(float t) {
     vec3 a = vec3(.16, .27, .66), b = vec3(.35, .70, .90), c = vec3(.98, .86, .38), d = vec3(.84, .15, .16);
     t = clamp(t, 0., 1.) * 3.;
     return t < 1. ? mix(a, b, t) : t < 2. ? mix(b, c, t - 1.) : mix(c, d, t - 2.);
   }
   void main() {
     vec4 p = view * vec4(low + size * position, 1.);
     gl_Position = vec4(focal * p.x / aspect, focal * p.y, -p.z * 1.0002 - .002, -p.z);
     gl_PointSize = max(1.5, radius * focal / -p.z);
     tint = mode == 0 ? color : ramp(value);
   }`,
  `precision mediump float; varying vec3 tint; uniform mediump int mode;
   void main() {
     vec2 q = 2. * gl_PointCoord - 1.;
     float r = dot(q, q);
     if (r > 1.) discard;
     float light = mode == 0 ? 1. : .6 + .4 * dot(vec3(q.x, -q.y, sqrt(1. - r)), vec3(-.35, .75, .56));
     gl_FragColor = vec4(tint * light, 1.);
   }`,
);
const lines = program(
  `attribute vec3 position; uniform mat4 view; uniform float focal, aspect;
   void main() { vec4 p = view * vec4(position, 1.); gl_Position = vec4(focal * p.x / aspect, focal * p.y, -p.z * 1.0002 - .002, -p.z); }`,
  `precision mediump float; void main() { gl_FragColor = vec4(.36, .39, .45, 1.); }`,
);

const buffer = { position: gl.createBuffer(), color: gl.createBuffer(), value: gl.createBuffer(), floor: gl.createBuffer() };
gl.bindBuffer(gl.ARRAY_BUFFER, buffer.floor);
gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(head.floor), gl.STATIC_DRAW);

const size = head.high.map((x, i) => Math.max(x - head.low[i], 1e-9));
const centre = head.low.map((x, i) => x + 0.5 * size[i]);
const reach = Math.hypot(...size);
let turn = 0.8, tilt = 0.35, distance = 1.9 * reach;

// Rows: right, above, towards the eye; the world's up is head.up.
function camera() {
  const up = head.up;
  const side = Math.abs(up[0]) < 0.9 ? [1, 0, 0] : [0, 1, 0];
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const unit = (a) => a.map((x) => x / Math.hypot(...a));
  const u = unit(cross(up, side)), v = cross(up, u);
  const back = up.map((x, i) => Math.sin(tilt) * x + Math.cos(tilt) * (Math.cos(turn) * u[i] + Math.sin(turn) * v[i]));
  const right = unit(cross(up, back)), above = cross(back, right);
  const eye = centre.map((x, i) => x + distance * back[i]);
  const far = (a) => -a.reduce((sum, x, i) => sum + x * eye[i], 0);
  return new Float32Array([
    right[0], above[0], back[0], 0, right[1], above[1], back[1], 0, right[2], above[2], back[2], 0, far(right), far(above), far(back), 1,
  ]);
}

function attribute(which, name, array, width, type, normalised) {
  const at = gl.getAttribLocation(which, name);
  if (at < 0) return;
  gl.enableVertexAttribArray(at);
  if (array) gl.bufferData(gl.ARRAY_BUFFER, array, gl.DYNAMIC_DRAW);
  gl.vertexAttribPointer(at, width, type, normalised, 0, 0);
}

function draw() {
  const ratio = window.devicePixelRatio || 1;
  canvas.width = Math.max(1, canvas.clientWidth * ratio);
  canvas.height = Math.max(1, canvas.clientHeight * ratio);
  gl.viewport(0, 0, canvas.width, canvas.height);
  gl.clearColor(0.086, 0.094, 0.114, 1);
  gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
  gl.enable(gl.DEPTH_TEST);
  const view = camera(), focal = 2.4, aspect = canvas.width / canvas.height;
  const common = (which) => {
    gl.useProgram(which);
    gl.uniformMatrix4fv(gl.getUniformLocation(which, "view"), false, view);
    gl.uniform1f(gl.getUniformLocation(which, "focal"), focal);
    gl.uniform1f(gl.getUniformLocation(which, "aspect"), aspect);
  };
  common(lines);
  gl.bindBuffer(gl.ARRAY_BUFFER, buffer.floor);
  attribute(lines, "position", null, 3, gl.FLOAT, false);
  gl.drawArrays(gl.LINES, 0, head.floor.length / 3);

  const frame = Number(slider.value), which = head.modes[mode.selectedIndex].kind, now = list(frame);
  common(balls);
  gl.uniform3fv(gl.getUniformLocation(balls, "low"), head.low);
  gl.uniform3fv(gl.getUniformLocation(balls, "size"), size);
  gl.uniform1f(gl.getUniformLocation(balls, "radius"), head.point_radius_m * canvas.height);
  gl.uniform1i(gl.getUniformLocation(balls, "mode"), which);
  gl.bindBuffer(gl.ARRAY_BUFFER, buffer.position);
  attribute(balls, "position", now.position, 3, gl.UNSIGNED_SHORT, true);
  gl.bindBuffer(gl.ARRAY_BUFFER, buffer.color);
  attribute(balls, "color", now.color, 3, gl.UNSIGNED_BYTE, true);
  gl.bindBuffer(gl.ARRAY_BUFFER, buffer.value);
  attribute(balls, "value", now.value[Math.max(which - 1, 0)], 1, gl.UNSIGNED_BYTE, true);
  gl.drawArrays(gl.POINTS, 0, points);
  document.getElementById("time").textContent = `frame ${frame}, ${head.times_s[frame].toFixed(3)} s`;
  document.getElementById("meaning").textContent = head.modes[mode.selectedIndex].legend;
}

slider.max = frames - 1;
for (const { name } of head.modes) mode.append(new Option(name));
// page.html#frame=7&mode=1 opens there.
const asked = new URLSearchParams(location.hash.slice(1));
if (asked.has("frame")) slider.value = asked.get("frame");
if (asked.has("mode")) mode.selectedIndex = Math.min(Number(asked.get("mode")), head.modes.length - 1);

let timer = null;
function play() {
  const button = document.getElementById("play");
  if (timer) { clearInterval(timer); timer = null; button.textContent = "play"; return; }
  button.textContent = "stop";
  timer = setInterval(() => { slider.value = (Number(slider.value) + 1) % frames; draw(); }, Math.max(1000 / head.frame_rate_hz, 30));
}
document.getElementById("play").addEventListener("click", play);
window.addEventListener("keydown", (e) => { if (e.key === " ") { e.preventDefault(); play(); } });
slider.addEventListener("input", draw);
mode.addEventListener("change", draw);
window.addEventListener("resize", draw);

const touches = new Map();
canvas.addEventListener("pointerdown", (e) => { touches.set(e.pointerId, [e.clientX, e.clientY]); canvas.setPointerCapture(e.pointerId); });
for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, (e) => touches.delete(e.pointerId));
const spread = () => { const [a, b] = [...touches.values()]; return Math.hypot(a[0] - b[0], a[1] - b[1]); };
canvas.addEventListener("pointermove", (e) => {
  const last = touches.get(e.pointerId);
  if (!last) return;
  const before = touches.size === 2 ? spread() : 0;
  touches.set(e.pointerId, [e.clientX, e.clientY]);
  if (touches.size === 2) {
    distance *= before / Math.max(spread(), 1);
  } else {
    turn += 0.008 * (e.clientX - last[0]);
    tilt = Math.min(1.5, Math.max(-1.5, tilt + 0.008 * (e.clientY - last[1])));
  }
  draw();
});
canvas.addEventListener("wheel", (e) => { e.preventDefault(); distance *= Math.exp(0.001 * e.deltaY); draw(); }, { passive: false });
draw();
