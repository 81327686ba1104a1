// Where the picture is seen from: a camera that can be turned around the motion, or one of the video's.
class Orbit {
  constructor(head, matter) {
    this.up = unit(head.up);
    this.frame = frameOf(this.up);
    this.low = matter.low_m;
    this.high = matter.high_m;
    this.reset();
  }

  reset() {
    this.target = scaled(add(this.low, this.high), 0.5);
    this.reach = Math.max(Math.hypot(...subtract(this.high, this.low)), 1e-6);
    this.distance = 1.35 * this.reach;
    [this.turn, this.tilt] = [0.8, 0.3];
  }

  rows() {
    const [u, v] = this.frame, { turn, tilt, up } = this;
    const back = add(scaled(up, Math.sin(tilt)), scaled(add(scaled(u, Math.cos(turn)), scaled(v, Math.sin(turn))), Math.cos(tilt)));
    const right = unit(cross(up, back));
    return [right, cross(right, back), scaled(back, -1)];
  }

  view(width, height) {
    const rows = this.rows(), focal = 1.2 * Math.min(width, height);
    return {
      rows, eye: subtract(this.target, scaled(rows[2], this.distance)), focal: [focal, focal], principal: [width / 2, height / 2],
      near: 0.02 * this.distance, far: this.distance + 6 * this.reach, metres: this.distance / focal,
    };
  }

  rotate(dx, dy) {
    this.turn -= 0.008 * dx;
    this.tilt = clamp(this.tilt + 0.008 * dy, -1.5, 1.5);
  }

  pan(dx, dy, height) {
    const rows = this.rows(), metres = this.distance / (1.2 * height);
    this.target = subtract(this.target, add(scaled(rows[0], dx * metres), scaled(rows[1], dy * metres)));
  }

  zoom(factor) {
    this.distance = clamp(this.distance * factor, 0.05 * this.reach, 20 * this.reach);
  }
}

// A camera of the video, its picture as large as fits; `zoom` and `shift` look at a part of it.
class FilmCamera {
  constructor(camera, orbit) {
    Object.assign(this, { camera, orbit });
    this.reset();
  }

  reset() {
    this.scale = 1;
    this.shift = [0, 0];
  }

  view(width, height) {
    const { size_px: [w, h], focal_px, principal_px, axes, centre_m } = this.camera;
    const scale = this.scale * Math.min(width / w, height / h);
    const left = (width - scale * w) / 2 + this.shift[0], top = (height - scale * h) / 2 + this.shift[1];
    const depth = dot(subtract(this.orbit.target, centre_m), axes[2]);
    return {
      rows: axes, eye: centre_m, focal: scaled(focal_px, scale), principal: [left + scale * principal_px[0], top + scale * principal_px[1]],
      near: 0.01 * Math.max(depth, 0.1), far: Math.max(depth, 0.1) + 6 * this.orbit.reach, metres: depth / (scale * focal_px[1]),
      frame: [left, top, left + scale * w, top + scale * h],
    };
  }

  pan(dx, dy) {
    this.shift = [this.shift[0] + dx, this.shift[1] + dy];
  }

  zoom(factor) {
    this.scale = clamp(this.scale / factor, 0.5, 20);
    this.shift = scaled(this.shift, 1 / factor);
  }
}
