// Draws a moment of the motion: picture, planes, shadows, obstacles, matter.
class Renderer {
  constructor(canvas, head, matter) {
    // Drawn on demand: the browser may ask for the picture at any time.
    const gl = canvas.getContext("webgl2", { antialias: false, alpha: false, preserveDrawingBuffer: true });
    if (!gl) throw new Error("this browser has no WebGL2");
    Object.assign(this, { gl, canvas, head, matter });
    this.programs = Object.fromEntries(Object.entries(SHADERS).map(([name, [vertex, fragment]]) => [name, this.program(vertex, fragment)]));
    this.order = new DepthOrder(matter.splats);
    this.moment = { frame: -1 };
    this.textures = {
      static: this.staticTexture(), particle: gl.createTexture(), speed: gl.createTexture(), normal: gl.createTexture(),
      order: gl.createTexture(), picture: gl.createTexture(), mask: gl.createTexture(),
    };
    this.corners = this.arrayOf([["corner", 2, 2, 0]], new Float32Array([-1, -1, 1, -1, -1, 1, 1, 1]));
    this.squares = this.squaresOf(matter.splats);
    this.empty = gl.createVertexArray();
    this.solids = head.obstacles.map((obstacle) => {
      const triangles = solidOf(obstacle);
      return triangles.length ? this.arrayOf([["place", 3, 6, 0], ["normal", 3, 6, 3]], triangles) : null;
    });
  }

  program(vertex, fragment) {
    const { gl } = this, made = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
      gl.attachShader(made, shader);
    }
    ["place", "normal", "corner"].forEach((name, i) => gl.bindAttribLocation(made, i, name));
    gl.linkProgram(made);
    if (!gl.getProgramParameter(made, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(made));
    const uniforms = new Map();
    for (let i = 0; i < gl.getProgramParameter(made, gl.ACTIVE_UNIFORMS); i++) {
      const { name, type } = gl.getActiveUniform(made, i);
      uniforms.set(name.replace("[0]", ""), { place: gl.getUniformLocation(made, name), type, isList: name.endsWith("[0]") });
    }
    return { made, uniforms };
  }

  // Starts to draw with a program; values of uniforms that it does not have are left out.
  use(name, values) {
    const { gl } = this, { made, uniforms } = this.programs[name];
    gl.useProgram(made);
    for (const [key, value] of Object.entries(values)) {
      const uniform = uniforms.get(key);
      if (!uniform) continue;
      const { place, type, isList } = uniform;
      if (type === gl.FLOAT) gl.uniform1f(place, value);
      else if (type === gl.FLOAT_VEC2) gl.uniform2fv(place, value);
      else if (type === gl.FLOAT_VEC3) gl.uniform3fv(place, value);
      else if (type === gl.FLOAT_VEC4) gl.uniform4fv(place, value);
      else if (isList) gl.uniform1iv(place, value);
      else gl.uniform1i(place, value);
    }
  }

  // Vertices of some attributes: name, width, stride and offset in numbers.
  arrayOf(attributes, numbers) {
    const { gl } = this, array = gl.createVertexArray();
    gl.bindVertexArray(array);
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, numbers, gl.STATIC_DRAW);
    for (const [name, width, stride, offset] of attributes) {
      const at = ["place", "normal", "corner"].indexOf(name);
      gl.enableVertexAttribArray(at);
      gl.vertexAttribPointer(at, width, gl.FLOAT, false, 4 * stride, 4 * offset);
    }
    return { array, count: numbers.length / attributes[0][2] };
  }

  // Two triangles for each of some splats. Instances would do, too, but cost much without hardware.
  squaresOf(count) {
    const { gl } = this, array = gl.createVertexArray(), corners = new Uint32Array(6 * count);
    for (let i = 0; i < count; i++) [0, 1, 2, 1, 3, 2].forEach((corner, k) => { corners[6 * i + k] = 4 * i + corner; });
    gl.bindVertexArray(array);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, corners, gl.STATIC_DRAW);
    return array;
  }

  // Orders the splats from afar to near.
  sort(view) {
    const { gl } = this;
    this.table(this.textures.order, gl.R32UI, gl.RED_INTEGER, gl.UNSIGNED_INT, 1, this.order.sort(this.matter.centres, view.eye, view.rows[2]), 4);
  }

  // Numbers in rows of 2048 texels.
  table(texture, internal, format, type, width, numbers, place = 0) {
    const { gl } = this, rows = Math.ceil(numbers.length / width / 2048) || 1;
    const padded = new numbers.constructor(rows * 2048 * width);
    padded.set(numbers);
    gl.activeTexture(gl.TEXTURE0 + place);
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    gl.pixelStorei(gl.UNPACK_FLIP_Y_WEBGL, false);
    gl.texImage2D(gl.TEXTURE_2D, 0, internal, 2048, rows, 0, format, type, padded);
    for (const side of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, side, gl.NEAREST);
  }

  staticTexture() {
    const { gl, matter } = this, texels = new Uint32Array(4 * matter.splats), texture = gl.createTexture();
    const offsets = new Uint16Array(matter.offsets.buffer), { colors } = matter;
    for (let i = 0; i < matter.splats; i++) {
      texels[4 * i] = matter.carriers[i];
      texels[4 * i + 1] = offsets[4 * i] | (offsets[4 * i + 1] << 16);
      texels[4 * i + 2] = offsets[4 * i + 2] | (offsets[4 * i + 3] << 16);
      texels[4 * i + 3] = colors[4 * i] | (colors[4 * i + 1] << 8) | (colors[4 * i + 2] << 16) | (colors[4 * i + 3] << 24);
    }
    this.table(texture, gl.RGBA32UI, gl.RGBA_INTEGER, gl.UNSIGNED_INT, 4, texels);
    return texture;
  }

  // Loads the lists of a frame.
  show(frame) {
    if (this.moment.frame === frame) return;
    const { gl, textures } = this, lists = this.matter.frame(frame);
    this.table(textures.particle, gl.RGBA16UI, gl.RGBA_INTEGER, gl.UNSIGNED_SHORT, 4, lists.particles);
    this.table(textures.speed, gl.R16UI, gl.RED_INTEGER, gl.UNSIGNED_SHORT, 1, lists.speeds);
    this.table(textures.normal, gl.RGB8I, gl.RGB_INTEGER, gl.BYTE, 3, lists.normals);
    this.matter.move(lists.particles);
    this.moment = { frame };
  }

  // Sets what lies behind: images of the same size, or nothing.
  setPicture(picture, mask) {
    const { gl, textures } = this;
    this.hasPicture = Boolean(picture);
    for (const [texture, image] of [[textures.picture, picture], [textures.mask, mask]]) {
      if (!image) continue;
      gl.activeTexture(gl.TEXTURE0);
      gl.bindTexture(gl.TEXTURE_2D, texture);
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, gl.RGBA, gl.UNSIGNED_BYTE, image);
      for (const side of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, side, gl.LINEAR);
      for (const side of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, side, gl.CLAMP_TO_EDGE);
    }
  }

  // view: the camera; look: mode, range, drawing, opacity, hidden bodies, what is shown.
  draw(view, look) {
    const { gl, head, matter, canvas } = this;
    const common = {
      right: view.rows[0], down: view.rows[1], forward: view.rows[2], eye: view.eye, focal: view.focal, principal: view.principal,
      viewport: [canvas.width, canvas.height], near: view.near, far: view.far, up: head.up,
    };
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.clearColor(0.086, 0.094, 0.114, 1);
    gl.depthMask(true);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    gl.disable(gl.DEPTH_TEST);
    const behind = view.frame && this.hasPicture && look.behind > 0;
    if (behind) this.drawPicture(view, look.behind);
    const ends = head.bodies.map(({ splats }) => splats).reduce((list, count) => [...list, (list.at(-1) ?? 0) + count], []);
    const [low, high] = matter.codedBox;
    const splat = {
      low, size: subtract(high, low), maxOffset: matter.max_offset_m, maxScale: matter.max_scale_m,
      mode: look.mode, range: look.range, hidden: look.hidden, opacity: look.opacity, spacing: matter.spacing_m,
      bodyEnds: [0, 1, 2, 3].map((i) => ends[i] ?? 2 ** 30), isLit: Boolean(matter.lights),
      light: (matter.lights ?? []).slice(0, 4).flat(2).concat(Array(108).fill(0)).slice(0, 108),
      staticTexture: 0, particleTexture: 1, speedTexture: 2, normalTexture: 3,
    };
    ["static", "particle", "speed", "normal"].forEach((name, i) => {
      gl.activeTexture(gl.TEXTURE0 + i);
      gl.bindTexture(gl.TEXTURE_2D, this.textures[name]);
    });
    if (look.floor && !behind) this.drawPlanes(common, splat);
    gl.enable(gl.DEPTH_TEST);
    if (look.obstacles) this.drawSolids(common);
    if (look.drawing === "splats") {
      gl.depthMask(false);
      this.sort(view);
      gl.bindVertexArray(this.squares);
      this.use("splats", { ...common, ...splat, orderTexture: 4 });
      gl.drawElements(gl.TRIANGLES, 6 * matter.splats, gl.UNSIGNED_INT, 0);
      gl.depthMask(true);
    } else {
      gl.bindVertexArray(this.empty);
      this.use("points", { ...common, ...splat });
      gl.drawArrays(gl.POINTS, 0, matter.splats);
    }
    gl.bindVertexArray(null);
  }

  drawPicture(view, shown) {
    const { gl, textures, canvas } = this, [x0, y0, x1, y1] = view.frame;
    ["picture", "mask"].forEach((name, i) => {
      gl.activeTexture(gl.TEXTURE0 + i);
      gl.bindTexture(gl.TEXTURE_2D, textures[name]);
    });
    const ndc = [(2 * x0) / canvas.width - 1, 1 - (2 * y1) / canvas.height, (2 * x1) / canvas.width - 1, 1 - (2 * y0) / canvas.height];
    gl.bindVertexArray(this.corners.array);
    this.use("picture", { frame: ndc, picture: 0, mask: 1, shown });
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
  }

  drawPlanes(common, splat) {
    const { gl, head, matter } = this;
    const centre = scaled(add(matter.low_m, matter.high_m), 0.5), half = 1.2 * Math.hypot(...subtract(matter.high_m, matter.low_m));
    for (const obstacle of head.obstacles.filter(({ shape }) => shape === "half_space")) {
      const pose = this.pose(obstacle), plane = unit(turned(pose.slice(3), obstacle.normal)), [across, along] = frameOf(plane);
      const height = dot(subtract(centre, pose), plane), middle = subtract(centre, scaled(plane, height));
      const isFloor = dot(plane, head.up) > 0.5, origin = [dot(middle, across), dot(middle, along)];
      gl.bindVertexArray(this.corners.array);
      this.use("planes", { ...common, middle, across, along, half_m: half, tile: roundLength(half / 8), strength: isFloor ? 0.8 : 0.3, lines: [0.52, 0.56, 0.63], origin });
      gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
      if (!isFloor) continue;
      const every = Math.ceil(matter.splats / 1500) || 1, count = Math.floor(matter.splats / every);
      gl.bindVertexArray(this.squares);
      const spread = 0.02 * half, area = 0.2 * half * half;
      this.use("shadows", { ...common, ...splat, every, middle, plane, across, along, spread, strength: clamp(area / (count * spread * spread * 3), 0.012, 0.5) });
      gl.drawElements(gl.TRIANGLES, 6 * count, gl.UNSIGNED_INT, 0);
    }
  }

  drawSolids(common) {
    const { gl } = this;
    this.solids.forEach((solid, i) => {
      if (!solid) return;
      const pose = this.pose(this.head.obstacles[i]);
      gl.bindVertexArray(solid.array);
      this.use("solids", { ...common, position: pose.slice(0, 3), rotation: pose.slice(3) });
      gl.drawArrays(gl.TRIANGLES, 0, solid.count);
    });
  }

  // Position and rotation of an obstacle in the frame that is shown.
  pose({ poses }) {
    return poses[Math.min(this.moment.frame, poses.length - 1)];
  }
}
