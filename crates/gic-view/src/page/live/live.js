// The twin simulated in the page: its particles, the module that moves them, and the controls.
class LiveMatter {
  constructor(head, { sizes, opacity }) {
    Object.assign(this, head);
    const n = head.particles, sizeOf = new Uint16Array(4 * n);
    this.carriers = Uint32Array.from({ length: n }, (_, i) => i);
    sizes.forEach((size, i) => { sizeOf[4 * i + 3] = Math.round(65535 * size); });
    this.offsets = new Int16Array(sizeOf.buffer); // no offset; x, y, z, size
    this.colors = new Uint8Array(4 * n).fill(Math.round(255 * opacity));
    this.centres = new Float32Array(3 * n);
    [this.speeds, this.stresses, this.outward] = [new Float32Array(n), new Float32Array(n), new Float32Array(3 * n)];
  }

  // The box that positions are shares of [m]: matter that leaves the view is still drawn.
  get codedBox() {
    const room = scaled(subtract(this.high_m, this.low_m), 3);
    return [subtract(this.low_m, room), add(this.high_m, room)];
  }

  // The lists for the renderer: positions with stress, speeds, normals.
  frame() {
    const n = this.particles, [low, high] = this.codedBox, size = subtract(high, low);
    this.max_stress_pa = Math.max(1e-9, ...this.stresses);
    this.max_speed_m_s = Math.max(1e-9, ...this.speeds);
    const particles = new Uint16Array(4 * n), speeds = new Uint16Array(n);
    for (let i = 0; i < n; i++) {
      for (let axis = 0; axis < 3; axis++) {
        particles[4 * i + axis] = clamp(Math.round((65535 * (this.centres[3 * i + axis] - low[axis])) / size[axis]), 0, 65535);
      }
      particles[4 * i + 3] = (65535 * this.stresses[i]) / this.max_stress_pa;
      speeds[i] = (65535 * this.speeds[i]) / this.max_speed_m_s;
    }
    return { particles, speeds, normals: Int8Array.from(this.outward, (x) => 127 * x) };
  }

  // The centres are the simulation's own.
  move() {}
}

// gic-live in WebAssembly; its interface is that of exports.rs.
class Simulation {
  static async open(module, numbers) {
    const { instance } = await WebAssembly.instantiate(bytesOf(module), {});
    return new Simulation(instance.exports, new Float64Array(bytesOf(numbers).buffer));
  }

  constructor(exports, numbers) {
    this.exports = exports;
    const at = exports.gic_reserve(numbers.length);
    new Float64Array(exports.memory.buffer, at, numbers.length).set(numbers);
    this.particles = exports.gic_start();
    if (!this.particles) throw new Error(this.message);
  }

  get message() {
    const { memory, gic_message, gic_message_length } = this.exports;
    return new TextDecoder().decode(new Uint8Array(memory.buffer, gic_message(), gic_message_length()));
  }

  get time_s() {
    return this.exports.gic_time();
  }

  get centre() {
    return [0, 1, 2].map((axis) => this.exports.gic_centre(axis));
  }

  // Copies the lists of the last frame.
  fill(matter) {
    const { exports, particles: n } = this;
    const list = (at, count) => new Float32Array(exports.memory.buffer, at, count);
    matter.centres.set(list(exports.gic_positions(), 3 * n));
    matter.speeds.set(list(exports.gic_speeds(), n));
    matter.stresses.set(list(exports.gic_stresses(), n));
    matter.outward.set(list(exports.gic_outward(), 3 * n));
  }

  // Calls a function of the module that tells whether it went well.
  call(name, ...values) {
    if (!this.exports[name](...values)) throw new Error(this.message);
  }

  // Where the matter under a ray is held [m]; null where there is none.
  grab(eye, direction) {
    if (!this.exports.gic_grab(...eye, ...direction)) return null;
    return [...new Float64Array(this.exports.memory.buffer, this.exports.gic_held(), 3)];
  }
}

// Longest that frames are simulated before one is drawn [ms]. Budget: a page that still answers.
const LONGEST_WORK_MS = 40;
// How slowly the range of the colours shrinks, per frame: a second halves it.
const RANGE_DECAY = 0.5 ** (1 / 60);

class LiveViewer extends Viewer {
  constructor(root) {
    super(root);
    root.classList.add("live");
    const text = (id) => document.getElementById(id).textContent;
    this.rate = 1;
    this.reached = { 1: 0, 2: 0 };
    this.fillParameters();
    this.part(".restart").addEventListener("click", () => this.restart());
    this.ready = Simulation.open(text("live-module"), text("live-numbers")).then((simulation) => {
      this.simulation = simulation;
      this.showMoment();
      this.play();
    });
    this.ready.catch((error) => this.tell(`The simulation cannot start: ${error.message}.`));
  }

  readMatter() {
    return new LiveMatter(this.head.matter, this.head.live);
  }

  // A line over the picture, until the next one.
  tell(text) {
    this.part(".failure").hidden = !text;
    this.part(".failure").textContent = text;
  }

  fillParameters() {
    const { parameters, gravity_m_s2, max_gravity_m_s2 } = this.head.live, pull = Math.hypot(...gravity_m_s2);
    const down = pull ? scaled(gravity_m_s2, 1 / pull) : [0, -1, 0];
    parameters.forEach((parameter, i) => this.addSlider(parameter, (value) => this.simulation.call("gic_set_parameter", i, value)));
    const gravity = { name: "Gravity", unit: "m/s²", factor: 1, value: pull, range: [0, max_gravity_m_s2], is_logarithmic: false };
    this.addSlider(gravity, (value) => this.simulation.call("gic_set_gravity", ...scaled(down, value)));
  }

  addSlider({ name, unit, factor, value, range, is_logarithmic }, set) {
    const label = document.createElement("label"), shown = document.createElement("output"), slider = document.createElement("input");
    const [to, from] = is_logarithmic ? [Math.log, Math.exp] : [(x) => x, (x) => x];
    const show = (x) => { shown.textContent = `${short(x * factor)} ${unit}`; };
    Object.assign(slider, { type: "range", min: to(range[0]), max: to(range[1]), step: "any", value: to(value), title: "double click: the twin's own value" });
    slider.setAttribute("aria-label", name);
    const change = (x) => {
      show(x);
      if (this.simulation) this.attempt(() => set(x));
    };
    slider.addEventListener("input", () => change(from(Number(slider.value))));
    slider.addEventListener("dblclick", () => { slider.value = to(value); change(value); });
    show(value);
    label.append(name, shown, slider);
    this.part(".parameters").append(label);
  }

  // Works on the simulation; what goes wrong is told, and stops the motion.
  attempt(action) {
    try {
      action();
      this.tell("");
      return true;
    } catch (error) {
      this.stop();
      this.tell(`${error.message}. Choose another value, or start again.`);
      return false;
    }
  }

  get frameNumber() {
    return Math.round(this.simulation.time_s * this.head.frame_rate_hz);
  }

  showMoment() {
    const { simulation, renderer, matter, head } = this;
    simulation.fill(matter);
    this.state.frame = this.frameNumber;
    renderer.moment = { frame: -1 };
    for (const [kind, list] of [[1, matter.stresses], [2, matter.speeds]]) {
      this.reached[kind] = Math.max(RANGE_DECAY * this.reached[kind], list.reduce((a, b) => Math.max(a, b), 1e-6));
      head.meanings.find((meaning) => meaning.kind === kind).range = [0, this.reached[kind]];
    }
    if (!this.root.querySelector(".scale-of-colors").contains(document.activeElement)) this.showRange();
    const pace = this.playing ? `, ${this.rate.toFixed(2)} x true speed` : "";
    this.part(".time").textContent = `${simulation.time_s.toFixed(2)} s${pace}`;
    this.refresh();
  }

  // One frame on.
  advance() {
    const { has_moving_obstacle } = this.head.live;
    if (has_moving_obstacle && this.frameNumber >= this.head.times_s.length - 1) {
      this.stop();
      this.tell("The obstacles' way ends here: start again.");
      return false;
    }
    return this.attempt(() => this.simulation.call("gic_advance"));
  }

  restart() {
    this.reached = { 1: 0, 2: 0 };
    this.attempt(() => this.simulation.call("gic_restart"));
    this.showMoment();
  }

  setFrame() {}

  step(by) {
    this.stop();
    if (by > 0 && this.simulation && this.advance()) this.showMoment();
  }

  play() {
    if (this.playing) {
      this.stop();
      return;
    }
    if (!this.simulation) return;
    this.part(".play").textContent = "pause";
    let due = 0, last = performance.now();
    const tick = (now) => {
      this.playing = requestAnimationFrame(tick);
      const wanted = ((now - last) / 1000) * this.head.frame_rate_hz;
      due = Math.min(due + wanted * Number(this.value(".speed")), this.head.frame_rate_hz / 10);
      const end = performance.now() + LONGEST_WORK_MS;
      let done = 0;
      while (due >= 1 && performance.now() < end && this.advance()) {
        due -= 1;
        done += 1;
      }
      if (wanted > 0) this.rate += 0.05 * (done / wanted - this.rate);
      last = now;
      if (done) this.showMoment();
    };
    this.playing = requestAnimationFrame(tick);
  }

  // The ray through a place of the picture: from the eye, one metre of depth.
  ray(x, y) {
    const ratio = window.devicePixelRatio || 1, view = this.camera.view(this.canvas.width, this.canvas.height);
    const [u, v] = [(x * ratio - view.principal[0]) / view.focal[0], (y * ratio - view.principal[1]) / view.focal[1]];
    return { eye: view.eye, forward: view.rows[2], along: add(add(scaled(view.rows[0], u), scaled(view.rows[1], v)), view.rows[2]) };
  }

  get hand() {
    let depth = 0, beside = [0, 0, 0];
    const onPlane = ({ eye, along }) => add(eye, scaled(along, depth));
    return {
      grab: (x, y) => {
        const ray = this.ray(x, y), held = this.simulation?.grab(ray.eye, unit(ray.along));
        if (!held) return false;
        depth = dot(subtract(held, ray.eye), ray.forward);
        beside = subtract(held, onPlane(ray));
        if (!this.playing) this.play();
        return true;
      },
      pull: (x, y) => this.simulation.exports.gic_pull(...add(onPlane(this.ray(x, y)), beside)),
      release: () => this.simulation.exports.gic_release(),
    };
  }

  // Frames that are simulated in a second, without drawing; for measurements.
  measureSimulation(frames = 60) {
    const start = performance.now();
    for (let i = 0; i < frames; i++) this.simulation.call("gic_advance");
    return (1000 * frames) / (performance.now() - start);
  }
}
