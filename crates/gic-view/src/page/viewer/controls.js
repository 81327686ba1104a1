// What a hand does on the picture: turn, move, nearer; one or two fingers. `hand`, if any, is asked whether it takes hold
// of what is under the first finger, and then pulls and lets go.
function watchPointers(canvas, { turn, move, zoom, hand }) {
  const touches = new Map();
  let holding = null;
  const spread = () => { const [a, b] = [...touches.values()]; return Math.hypot(a[0] - b[0], a[1] - b[1]); };
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("pointerdown", (event) => {
    touches.set(event.pointerId, [event.clientX, event.clientY]);
    canvas.setPointerCapture(event.pointerId);
    const isPlain = event.button === 0 && !event.shiftKey && touches.size === 1;
    if (hand && isPlain && hand.grab(event.offsetX, event.offsetY)) holding = event.pointerId;
  });
  for (const end of ["pointerup", "pointercancel"]) {
    canvas.addEventListener(end, (event) => {
      touches.delete(event.pointerId);
      if (event.pointerId !== holding) return;
      holding = null;
      hand.release();
    });
  }
  canvas.addEventListener("pointermove", (event) => {
    const last = touches.get(event.pointerId);
    if (!last) return;
    const before = touches.size === 2 ? spread() : 0, dx = event.clientX - last[0], dy = event.clientY - last[1];
    touches.set(event.pointerId, [event.clientX, event.clientY]);
    if (holding !== null) {
      if (event.pointerId === holding) hand.pull(event.offsetX, event.offsetY);
    } else if (touches.size === 2) {
      zoom(before / Math.max(spread(), 1));
      move(dx / 2, dy / 2);
    } else if (event.shiftKey || event.buttons & 6) move(dx, dy);
    else turn(dx, dy);
  });
  canvas.addEventListener("wheel", (event) => { event.preventDefault(); zoom(Math.exp(0.001 * event.deltaY)); }, { passive: false });
}

// The world's axes and a length, over the picture.
function drawOverlay(svg, view, width, height, ratio) {
  const [x0, y0] = [46, height - 92], lines = [];
  ["x", "y", "z"].map((name, i) => {
    const axis = [0, 0, 0];
    axis[i] = 1;
    const [right, down, forward] = view.rows.map((row) => dot(row, axis));
    return { name, right, down, forward, color: ["#ff6b6b", "#7bd88f", "#6aa8ff"][i] };
  }).sort((a, b) => b.forward - a.forward).forEach(({ name, right, down, color }) => {
    const [x, y] = [x0 + 28 * right, y0 + 28 * down];
    lines.push(`<line x1="${x0}" y1="${y0}" x2="${x}" y2="${y}" stroke="${color}" stroke-width="2"/><text x="${x0 + 38 * right - 3}" y="${y0 + 38 * down + 4}" style="fill:${color}">${name}</text>`);
  });
  const length = roundLength(view.metres * ratio * Math.min(160, width / 4)), pixels = length / (view.metres * ratio);
  const left = 110, y = height - 68;
  lines.push(`<path d="M${left} ${y - 5}v5h${pixels}v-5" fill="none" stroke="#d8dbe2" stroke-width="1.5"/><text x="${left + pixels / 2}" y="${y - 6}" text-anchor="middle">${lengthText(length)}</text>`);
  svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
  svg.innerHTML = lines.join("");
}
