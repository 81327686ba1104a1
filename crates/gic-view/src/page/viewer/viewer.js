// The page's element: reads the data, keeps the state, answers the controls.
class Viewer {
  constructor(root) {
    const text = (id) => document.getElementById(id).textContent;
    this.root = root;
    this.head = JSON.parse(text("viewer-head"));
    this.video = JSON.parse(text("video-data"));
    this.canvas = this.part("canvas");
    this.matter = this.readMatter(text("viewer-data"));
    this.orbit = new Orbit(this.head, this.matter);
    this.images = new Map();
    this.listeners = [];
    this.state = { frame: 0, hidden: 0, ranges: {} };
    try {
      this.renderer = new Renderer(this.canvas, this.head, this.matter);
    } catch (error) {
      this.part(".failure").hidden = false;
      this.part(".failure").textContent = `The picture in three dimensions cannot be shown: ${error.message}.`;
      return;
    }
    this.fillControls();
    this.answerControls();
    this.readAddress();
    new ResizeObserver(() => this.refresh()).observe(this.canvas);
    this.refresh();
  }

  readMatter(text) {
    return new Matter(this.head.matter, text);
  }

  part(selector) {
    return this.root.querySelector(selector);
  }

  value(selector) {
    return this.part(selector).value;
  }

  // What colours may mean: name, unit, factor from SI, range in SI.
  get meaning() {
    return this.head.meanings[this.part(".mode").selectedIndex];
  }

  get camera() {
    const chosen = this.value(".camera");
    return chosen === "" ? this.orbit : this.films[Number(chosen)];
  }

  fillControls() {
    const { head, video } = this;
    head.meanings.forEach(({ name }) => this.part(".mode").append(new Option(name, name)));
    this.films = video ? video.cameras.map((camera) => new FilmCamera(camera, this.orbit)) : [];
    (video?.cameras ?? []).forEach(({ name }, i) => this.part(".camera").append(new Option(`camera ${name}`, i)));
    this.root.querySelectorAll(".film-only").forEach((label) => { label.hidden = !video; });
    this.part(".obstacles-only").hidden = !head.obstacles.some(({ shape }) => shape !== "half_space");
    this.part(".frame").max = head.times_s.length - 1;
    if (head.bodies.length > 1) {
      const hues = ["#cc946b", "#6b9ecc", "#8cbf73", "#bf80b8"];
      head.bodies.slice(0, 4).forEach(({ name }, i) => {
        const label = document.createElement("label"), box = document.createElement("input"), swatch = document.createElement("span");
        Object.assign(box, { type: "checkbox", checked: true });
        swatch.className = "swatch";
        swatch.style.background = hues[i];
        box.addEventListener("change", () => { this.state.hidden ^= 1 << i; this.refresh(); });
        label.append(box, swatch, i === 3 && head.bodies.length > 4 ? "all others" : name);
        this.part(".bodies").append(label);
      });
    }
  }

  answerControls() {
    const on = (selector, event, answer) => this.part(selector).addEventListener(event, answer);
    for (const selector of [".drawing", ".behind", ".opacity", ".floor", ".obstacles"]) on(selector, "input", () => this.refresh());
    on(".camera", "input", () => { this.camera.reset(); this.refresh(); });
    on(".mode", "input", () => { this.showRange(); this.refresh(); });
    on(".frame", "input", () => { this.stop(); this.setFrame(Number(this.value(".frame"))); });
    on(".back", "click", () => this.step(-1));
    on(".forth", "click", () => this.step(1));
    on(".play", "click", () => this.play());
    on(".reset", "click", () => this.resetView());
    on(".auto", "click", () => { delete this.state.ranges[this.meaning.name]; this.showRange(); this.refresh(); });
    for (const end of [".low", ".high"]) {
      on(end, "change", () => {
        const range = [".low", ".high"].map((selector) => Number(this.value(selector)) / this.meaning.factor);
        if (range[1] > range[0]) this.state.ranges[this.meaning.name] = range;
        this.showRange();
        this.refresh();
      });
    }
    this.root.addEventListener("keydown", (event) => {
      const inField = event.target.matches("select, input:not([type=range]):not([type=checkbox])");
      const answers = { " ": () => this.play(), ArrowLeft: () => this.step(-1), ArrowRight: () => this.step(1), r: () => this.resetView() };
      if (inField || !answers[event.key]) return;
      if (event.key === " " && event.target.matches("button, summary, [type=checkbox]")) return;
      event.preventDefault();
      answers[event.key]();
    });
    const ratio = () => window.devicePixelRatio || 1;
    watchPointers(this.canvas, {
      // A camera of the video cannot be turned: the free one takes over.
      turn: (dx, dy) => { this.part(".camera").value = ""; this.orbit.rotate(dx, dy); this.refresh(); },
      move: (dx, dy) => { this.camera.pan(dx * ratio(), dy * ratio(), Math.min(this.canvas.height, this.canvas.width)); this.refresh(); },
      zoom: (factor) => { this.camera.zoom(factor); this.refresh(); },
      hand: this.hand,
    });
  }

  // What answers a press on the picture before the view does: nothing.
  get hand() {
    return null;
  }

  // page.html#frame=7&colour=stress&draw=points&camera=0 opens there.
  readAddress() {
    const asked = new URLSearchParams(location.hash.slice(1));
    const choose = (selector, value) => {
      const list = this.part(selector);
      if (value !== null && [...list.options].some((option) => option.value === value)) list.value = value;
    };
    choose(".mode", asked.get("colour"));
    choose(".drawing", asked.get("draw"));
    choose(".camera", asked.get("camera"));
    this.showRange();
    this.setFrame(clamp(Number(asked.get("frame")) || 0, 0, this.head.times_s.length - 1));
  }

  resetView() {
    this.camera.reset();
    this.refresh();
  }

  showRange() {
    const { meaning } = this;
    this.part(".scale-of-colors").hidden = !meaning.range;
    if (!meaning.range) return;
    const range = this.state.ranges[meaning.name] ?? meaning.range;
    this.part(".what").textContent = `${meaning.title} [${meaning.unit}]`;
    this.part(".low").value = short(range[0] * meaning.factor);
    this.part(".high").value = short(range[1] * meaning.factor);
  }

  setFrame(frame) {
    const { times_s } = this.head;
    this.state.frame = frame;
    this.part(".frame").value = frame;
    this.part(".time").textContent = `frame ${frame} of ${times_s.length - 1}, ${times_s[frame].toFixed(3)} s`;
    this.listeners.forEach((listener) => listener(frame));
    this.refresh();
  }

  // Calls back with every frame that is shown from now on.
  onFrame(listener) {
    this.listeners.push(listener);
  }

  step(by) {
    this.stop();
    const count = this.head.times_s.length;
    this.setFrame((this.state.frame + by + count) % count);
  }

  stop() {
    cancelAnimationFrame(this.playing);
    this.playing = 0;
    this.part(".play").textContent = "play";
  }

  play() {
    if (this.playing) return this.stop();
    this.part(".play").textContent = "stop";
    const { times_s, frame_rate_hz } = this.head;
    let time = this.state.frame === times_s.length - 1 ? 0 : this.state.frame, last = performance.now();
    const tick = (now) => {
      time = (time + ((now - last) / 1000) * frame_rate_hz * Number(this.value(".speed"))) % times_s.length;
      last = now;
      if (Math.floor(time) !== this.state.frame) this.setFrame(Math.floor(time));
      this.playing = requestAnimationFrame(tick);
    };
    this.playing = requestAnimationFrame(tick);
  }

  // Draws at the browser's next occasion, once.
  refresh() {
    if (this.pending) return;
    this.pending = requestAnimationFrame(() => { this.pending = 0; this.draw(); });
  }

  draw() {
    const ratio = window.devicePixelRatio || 1, { canvas, renderer, meaning, state } = this;
    const width = Math.max(1, Math.round(canvas.clientWidth * ratio)), height = Math.max(1, Math.round(canvas.clientHeight * ratio));
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    const view = this.camera.view(width, height);
    this.putPicture();
    renderer.show(state.frame);
    const largest = { 1: this.matter.max_stress_pa, 2: this.matter.max_speed_m_s }[meaning.kind] ?? 1;
    const range = (state.ranges[meaning.name] ?? meaning.range ?? [0, 1]).map((value) => value / largest);
    renderer.draw(view, {
      mode: meaning.kind, range, drawing: this.value(".drawing"), opacity: Number(this.value(".opacity")), hidden: state.hidden,
      behind: Number(this.value(".behind")), floor: this.part(".floor").checked, obstacles: this.part(".obstacles").checked,
    });
    drawOverlay(this.part(".overlay"), view, width / ratio, height / ratio, ratio);
  }

  // Gives the renderer the picture of the chosen camera at the time that is shown.
  putPicture() {
    if (this.value(".camera") === "") return;
    const time = this.head.times_s[this.state.frame], { times_s, cameras } = this.video;
    const frame = times_s.findIndex((t) => Math.abs(t - time) < 0.5 / this.head.frame_rate_hz);
    const shot = cameras[Number(this.value(".camera"))].shots[frame];
    if (this.shot === shot) return;
    this.shot = shot;
    this.renderer.setPicture(null, null);
    if (!shot) return;
    Promise.all([this.image(`data:image/jpeg;base64,${shot.picture}`), this.image(`data:image/png;base64,${shot.mask}`)]).then(([picture, mask]) => {
      if (this.shot !== shot) return;
      this.renderer.setPicture(picture, mask);
      this.refresh();
    });
  }

  async image(address) {
    const image = new Image();
    image.src = address;
    await image.decode();
    return image;
  }

  // Milliseconds per picture of some, each turned and sorted anew; for measurements.
  measure(pictures = 30) {
    const { gl } = this.renderer, pixel = new Uint8Array(4), start = performance.now();
    for (let i = 0; i < pictures; i++) {
      this.orbit.rotate(3, 0);
      this.setFrame((this.state.frame + 1) % this.head.times_s.length);
      this.draw();
      gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
    }
    return (performance.now() - start) / pictures;
  }
}
