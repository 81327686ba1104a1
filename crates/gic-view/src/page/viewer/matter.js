function bytesOf(base64) {
  const text = atob(base64), bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  return bytes;
}

// The matter of the page: splats, each carried by a particle. The layout of the bytes is that of matter.rs.
class Matter {
  constructor(head, base64) {
    const bytes = bytesOf(base64);
    Object.assign(this, head);
    this.bytes = bytes;
    const { particles: n, splats: m } = head;
    this.carriers = new Uint32Array(bytes.slice(0, 4 * m).buffer);
    this.offsets = new Int16Array(bytes.slice(4 * m, 12 * m).buffer); // x, y, z, size
    this.colors = bytes.subarray(12 * m, 16 * m);
    this.frameBytes = 10 * n + 3 * m;
    this.centres = new Float32Array(3 * m);
    this.current = -1;
  }

  // The box that positions are shares of [m].
  get codedBox() {
    return [this.low_m, this.high_m];
  }

  // The lists of a frame: positions with stress, speeds, normals.
  frame(index) {
    const { particles: n, splats: m } = this, at = 16 * m + index * this.frameBytes;
    return {
      particles: new Uint16Array(this.bytes.slice(at, at + 8 * n).buffer),
      speeds: new Uint16Array(this.bytes.slice(at + 8 * n, at + 10 * n).buffer),
      normals: new Int8Array(this.bytes.slice(at + 10 * n, at + 10 * n + 3 * m).buffer),
    };
  }

  // Moves the centres of the splats [m] to those of a frame.
  move(particles) {
    const { carriers, offsets, centres } = this;
    const unit = this.max_offset_m / 32767;
    for (let axis = 0; axis < 3; axis++) {
      const low = this.low_m[axis], step = (this.high_m[axis] - low) / 65535;
      for (let i = 0; i < this.splats; i++) {
        centres[3 * i + axis] = low + step * particles[4 * carriers[i] + axis] + unit * offsets[4 * i + axis];
      }
    }
  }
}

// The order of the splats from far to near, by counting their depths in 65536 steps.
class DepthOrder {
  constructor(count) {
    this.depths = new Float32Array(count);
    this.keys = new Uint16Array(count);
    this.order = new Uint32Array(count);
    this.starts = new Uint32Array(65537);
  }

  sort(centres, eye, forward) {
    const { depths, keys, order, starts } = this, count = depths.length;
    const [fx, fy, fz] = forward, base = fx * eye[0] + fy * eye[1] + fz * eye[2];
    let near = Infinity, far = -Infinity;
    for (let i = 0; i < count; i++) {
      const depth = fx * centres[3 * i] + fy * centres[3 * i + 1] + fz * centres[3 * i + 2] - base;
      depths[i] = depth;
      if (depth < near) near = depth;
      if (depth > far) far = depth;
    }
    const step = 65535 / Math.max(far - near, 1e-9);
    starts.fill(0);
    for (let i = 0; i < count; i++) {
      const key = clamp(65535 - (depths[i] - near) * step, 0, 65535) | 0;
      keys[i] = key;
      starts[key + 1]++;
    }
    for (let key = 1; key < 65537; key++) starts[key] += starts[key - 1];
    for (let i = 0; i < count; i++) order[starts[keys[i]]++] = i;
    return order;
  }
}
