// Plots over time: uPlot, always fed with the least and greatest value of each pixel of what is visible.
class Plots {
  constructor(body, duration, onTime, onZoom) {
    this.body = body; this.duration = duration; this.onTime = onTime; this.onZoom = onZoom;
    this.from = 0; this.to = duration; this.now = 0; this.shown = [];
    this.resized = new ResizeObserver(() => { const w = this.width(); for (const p of this.shown) if (p.u && Math.abs(p.u.width - w) > 2) { p.u.setSize({ width: w, height: p.height }); this.feed(p); } });
    this.resized.observe(body);
  }
  width() { return Math.max(this.body.clientWidth - 18, 240); }

  // specs: { id, label, unit, series: [{ label, colour, t, y, step, x? }], log, height }
  show(specs) {
    for (const p of this.shown) p.u.destroy();
    this.body.replaceChildren();
    this.shown = [];
    for (const spec of specs) this.shown.push(this.one(spec));
    this.setTime(this.now);
  }

  one(spec) {
    const host = make("div", { class: "plot", "data-plot": spec.id }), p = { spec, host, height: spec.height || 132 }, ink = css("--soft"), grid = css("--grid");
    this.body.append(host);
    const axis = (extra) => ({ stroke: ink, grid: { stroke: grid, width: 1 }, ticks: { stroke: grid, width: 1, size: 4 }, font: "11px system-ui, sans-serif", labelFont: "11px system-ui, sans-serif", ...extra });
    const options = {
      width: this.width(), height: p.height, padding: [8, 12, 0, 0], legend: { show: true, live: false },
      cursor: { sync: { key: "time" }, drag: { x: true, y: false, setScale: false }, points: { size: 6 } },
      scales: { x: { time: false, range: () => [this.from, this.to] }, y: spec.log ? { distr: 3 } : { range: spec.range || ((u, a, b) => { const pad = (b - a) * .06 || Math.abs(b) * .1 || 1; return [a - pad, b + pad]; }) } },
      axes: [axis({ size: 26, values: (u, ticks) => ticks.map((s) => this.to - this.from > 600 ? clockText(s).replace(/\.\d+$/, "") : short(s) === "0" ? "0" : +s.toFixed(6) + "") }),
        axis({ size: 58, label: spec.label + (spec.unit ? ", " + spec.unit : ""), labelSize: 16, values: (u, ticks) => ticks.map((v) => v == null ? "" : Math.abs(v) >= 1e4 ? v.toExponential(0) : +v.toPrecision(5) + "") })],
      series: [{}, ...spec.series.map((s) => ({ label: s.label, stroke: s.colour, width: s.width || 1.4, fill: s.fill, points: { show: false },
        dash: s.dash, paths: s.step ? uPlot.paths.stepped({ align: 1 }) : undefined, spanGaps: true }))],
      hooks: { draw: [() => { if (p.line) this.place(p); }], setSelect: [(u) => { if (u.select.width > 4) { const a = u.posToVal(u.select.left, "x"), b = u.posToVal(u.select.left + u.select.width, "x"); u.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false); this.zoom(a, b); } }] },
    };
    p.u = new uPlot(options, this.data(spec), host);
    p.line = make("div", { class: "cursor-line" });
    p.u.over.append(p.line);
    let down = 0;
    p.u.over.addEventListener("mousedown", (e) => { down = e.clientX; });
    p.u.over.addEventListener("mouseup", (e) => { if (Math.abs(e.clientX - down) < 4) this.onTime(p.u.posToVal(e.clientX - p.u.over.getBoundingClientRect().left, "x")); });
    p.u.over.addEventListener("dblclick", () => this.zoom(0, this.duration));
    host.append(make("div", { class: "save" }, make("button", { title: "save as PNG", onclick: () => savePng(p) }, "PNG"), make("button", { title: "save as SVG", onclick: () => saveSvg(p, this) }, "SVG")));
    return p;
  }

  // Aligned columns for uPlot: one column of times for all series, two points a pixel.
  data(spec) {
    const pixels = Math.max(Math.round(this.width()), 200), span = this.to - this.from || 1, times = [], columns = spec.series.map(() => []);
    const sparse = spec.series.every((s) => s.t === spec.series[0].t) && countIn(spec.series[0].t, this.from, this.to) <= 2 * pixels;
    if (sparse) {
      const t = spec.series[0].t, a = Math.max(lastAtOrBefore(t, this.from), 0), b = Math.min(lastAtOrBefore(t, this.to) + 1, t.length - 1);
      for (let i = a; i <= b; i++) { times.push(t[i]); spec.series.forEach((s, k) => columns[k].push(valueOrNull(s.y[Math.min(i, s.y.length - 1)]))); }
      return [times, ...columns];
    }
    for (let i = 0; i < pixels; i++) times.push(this.from + span * (i + .25) / pixels, this.from + span * (i + .75) / pixels);
    spec.series.forEach((s, k) => extremes(s, this.from, this.to, pixels, columns[k], spec.log));
    return [times, ...columns];
  }

  feed(p) { p.u.setData(this.data(p.spec)); this.place(p); }
  zoom(a, b) {
    const least = Math.max(this.duration * 1e-7, 1e-5);
    if (b - a < least) b = a + least;
    this.from = Math.max(a, 0); this.to = Math.min(b, this.duration);
    for (const p of this.shown) this.feed(p);
    this.onZoom();
  }
  place(p) {
    const x = p.u.valToPos(this.now, "x"), inside = this.now >= this.from && this.now <= this.to;
    p.line.style.left = x + "px"; p.line.style.display = inside ? "" : "none";
  }
  setTime(s) { this.now = s; for (const p of this.shown) this.place(p); }
}

const valueOrNull = (v) => v == null || v !== v ? null : v;
function countIn(t, from, to) { return lastAtOrBefore(t, to) - lastAtOrBefore(t, from); }

// Least and greatest value of a series in each pixel; between samples it is straight, or stands (step).
function extremes(s, from, to, pixels, out, log) {
  const { t, y } = s, n = Math.min(t.length, y.length), span = to - from || 1;
  let i = Math.max(lastAtOrBefore(t, from), 0), last = null;
  const valueAtTime = (x) => {
    if (!n || x < t[0] || x > t[t.length - 1]) return null;
    let k = i; while (k + 1 < n && t[k + 1] <= x) k++;
    while (k > 0 && t[k] > x) k--;
    if (s.step || k + 1 >= n || t[k + 1] === t[k]) return valueOrNull(y[k]);
    const f = (x - t[k]) / (t[k + 1] - t[k]);
    return valueOrNull(y[k] + f * (y[k + 1] - y[k]));
  };
  for (let p = 0; p < pixels; p++) {
    const begin = from + span * p / pixels, end = from + span * (p + 1) / pixels;
    while (i < n && t[i] < begin) i++;
    let low = Infinity, high = -Infinity, lowFirst = true, j = i;
    for (; j < n && t[j] < end; j++) { const v = y[j]; if (v < low) { low = v; lowFirst = false; } if (v > high) { high = v; lowFirst = true; } }
    i = Math.max(j - 1, 0);
    if (low === Infinity) { const v = valueAtTime(0.5 * (begin + end)); out.push(v, v); last = v; } else if (lowFirst) out.push(low, high); else out.push(high, low);
    i = j;
    if (i > 0 && (i >= n || t[i] > end)) i--;
  }
  if (log) for (let k = 0; k < out.length; k++) if (!(out[k] > 0)) out[k] = null;
}

function download(name, blob) { const a = make("a", { href: URL.createObjectURL(blob), download: name }); a.click(); setTimeout(() => URL.revokeObjectURL(a.href), 1000); }
function savePng(p) { p.u.ctx.canvas.toBlob((blob) => download(p.spec.id + ".png", blob)); }
function saveSvg(p, plots) { download(p.spec.id + ".svg", new Blob([plotSvg(p, plots)], { type: "image/svg+xml" })); }
function plotSvg(p, plots) {
  const w = 900, h = 260, l = 62, b = 30, data = p.u.data, ys = p.u.scales.y, X = (t) => l + (w - l - 12) * (t - plots.from) / (plots.to - plots.from);
  const f = p.spec.log ? Math.log10 : (v) => v, Y = (v) => 12 + (h - b - 12) * (1 - (f(v) - f(ys.min)) / (f(ys.max) - f(ys.min)));
  const lines = p.spec.series.map((s, k) => `<polyline fill="none" stroke="${s.colour}" stroke-width="1.2" points="${data[0].map((t, i) => data[k + 1][i] == null ? "" : X(t).toFixed(1) + "," + Y(data[k + 1][i]).toFixed(1)).join(" ")}"/>`);
  const marks = [0, .25, .5, .75, 1].map((s) => { const t = plots.from + s * (plots.to - plots.from); return `<text x="${X(t)}" y="${h - 10}" text-anchor="middle">${short(t)} s</text>`; });
  const levels = [ys.min, ys.max].map((v) => `<text x="${l - 6}" y="${Y(v) + 4}" text-anchor="end">${short(v)}</text>`);
  return `<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 ${w} ${h}" font-family="sans-serif" font-size="11"><rect width="${w}" height="${h}" fill="#fff"/><rect x="${l}" y="12" width="${w - l - 12}" height="${h - b - 12}" fill="none" stroke="#ccc"/>${lines.join("")}${marks.join("")}${levels.join("")}<text x="${l}" y="10">${p.spec.label}${p.spec.unit ? ", " + p.spec.unit : ""}</text></svg>`;
}
