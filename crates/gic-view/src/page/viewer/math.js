// Vectors are arrays of three numbers, rotations arrays of three rows.
const add = (a, b) => a.map((x, i) => x + b[i]);
const subtract = (a, b) => a.map((x, i) => x - b[i]);
const scaled = (a, s) => a.map((x) => s * x);
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a) => scaled(a, 1 / (Math.hypot(...a) || 1));
const clamp = (x, low, high) => Math.min(high, Math.max(low, x));

// Two unit vectors that make a right-handed frame with a unit vector: across, along, normal.
function frameOf(normal) {
  const side = Math.abs(normal[0]) < 0.9 ? [1, 0, 0] : [0, 1, 0];
  const along = unit(cross(normal, side));
  return [cross(along, normal), along];
}

// A vector turned by a quaternion x, y, z, w.
function turned(q, v) {
  const t = scaled(cross(q, v), 2);
  return add(add(v, scaled(t, q[3])), cross(q, t));
}

// The longest of 1, 2, 5 times a power of ten that is not above a length.
function roundLength(length) {
  const power = 10 ** Math.floor(Math.log10(length));
  return [5, 2, 1].find((digit) => digit * power <= length * 1.0001) * power;
}

// A number in few characters, and a length with its unit.
const short = (x) => (x === 0 ? "0" : Math.abs(x) >= 1e5 || Math.abs(x) < 1e-3 ? x.toExponential(1) : String(Number(x.toPrecision(3))));
const lengthText = (m) => (m >= 1 ? `${short(m)} m` : m >= 0.01 ? `${short(100 * m)} cm` : `${short(1000 * m)} mm`);
