// The legend is a histogram: how long the path is in which colour. Drag over it to see only that part of the path.
class Legend {
  constructor(host, modes, path, onChange) {
    this.host = host; this.path = path; this.onChange = onChange; this.brush = { low: 0, high: 1, off: new Set() };
    this.select = make("select", { id: "colour", title: "what the colour shows", onchange: () => this.set(this.select.value) });
    this.body = make("div");
    host.append(make("h2", {}, "colour", this.select), this.body);
    this.setModes(modes, path);
  }
  setModes(modes, path) {
    this.path = path; this.modes = modes;
    const before = this.select.value;
    this.select.replaceChildren(...modes.map((m) => make("option", { value: m.id }, m.label)));
    if (before) this.select.value = before;
  }
  set(id) {
    this.select.value = id;
    this.mode = this.modes.find((m) => m.id === id) || this.modes[0];
    this.spread = spreadOf(this.mode, this.path);
    this.brush = { low: 0, high: 1, off: new Set() };
    this.paint();
    this.onChange(this.mode, this.spread, this.brush);
  }
  paint() { if (this.mode.kinds) this.kinds(); else this.histogram(); }

  kinds() {
    const total = this.spread.time.reduce((a, b) => a + b, 0) || 1;
    const keys = make("div", { class: "keys", style: "grid-template-columns: 1fr" });
    this.mode.kinds.forEach((name, k) => {
      if (!this.spread.time[k]) return;
      const box = make("b"), label = make("label", { "data-kind": name }, box, name, make("span", { class: "num" }, (100 * this.spread.time[k] / total).toFixed(1) + " %"));
      box.style.background = KINDS[k % KINDS.length];
      label.classList.toggle("off", this.brush.off.has(k));
      label.addEventListener("click", () => { const off = this.brush.off; off.has(k) ? off.delete(k) : off.add(k); label.classList.toggle("off", off.has(k)); this.onChange(this.mode, this.spread, this.brush); });
      keys.append(label);
    });
    this.body.replaceChildren(keys, make("div", { class: "hint" }, "share of the time; click to hide"));
  }

  histogram() {
    const canvas = make("canvas", { id: "legend", width: 612, height: 128, style: "cursor: crosshair; touch-action: none" }), map = RAMPS[this.mode.ramp], spread = this.spread, bins = spread.time.length;
    const draw = () => {
      const c = canvas.getContext("2d"), w = canvas.width, h = canvas.height, bar = 16, most = Math.max(...spread.time) || 1;
      c.clearRect(0, 0, w, h);
      for (let i = 0; i < bins; i++) {
        const x = i / bins, o = 3 * Math.round(255 * (i + .5) / bins), inside = (i + .5) / bins >= this.brush.low && (i + .5) / bins <= this.brush.high;
        c.globalAlpha = inside ? 1 : .18;
        c.fillStyle = `rgb(${map[o]},${map[o + 1]},${map[o + 2]})`;
        const tall = spread.time[i] ? Math.max(Math.sqrt(spread.time[i] / most) * (h - bar - 34), 3) : 0;
        c.fillRect(x * w, h - bar - 26 - tall, w / bins + .5, tall);
        c.fillRect(x * w, h - bar - 22, w / bins + .5, bar);
      }
      c.globalAlpha = 1; c.fillStyle = css("--soft"); c.font = "20px system-ui, sans-serif";
      for (const [x, align] of [[0, "left"], [.5, "center"], [1, "right"]]) { c.textAlign = align; c.fillText(short(valueAt(spread, x)), x * w, h - 2); }
    };
    let from = null;
    const share = (e) => { const b = canvas.getBoundingClientRect(); return Math.min(Math.max((e.clientX - b.left) / b.width, 0), 1); };
    canvas.addEventListener("pointerdown", (e) => { from = share(e); canvas.setPointerCapture(e.pointerId); });
    canvas.addEventListener("pointermove", (e) => { if (from === null) return; const to = share(e); this.brush.low = Math.min(from, to); this.brush.high = Math.max(from, to); draw(); });
    canvas.addEventListener("pointerup", () => { if (from === null) return; if (this.brush.high - this.brush.low < .015) { this.brush.low = 0; this.brush.high = 1; } from = null; draw(); this.note(); this.onChange(this.mode, this.spread, this.brush); });
    this.words = make("div", { class: "hint" });
    this.body.replaceChildren(canvas, this.words);
    this.note();
    draw();
  }
  note() {
    const b = this.brush, unit = this.mode.unit ? " " + this.mode.unit : "";
    this.words.textContent = b.low > 0 || b.high < 1 ? `shown: ${short(valueAt(this.spread, b.low))} to ${short(valueAt(this.spread, b.high))}${unit}; click to show all`
      : `time spent at each value${unit ? "," + unit : ""}; drag to show a part only`;
  }
}
