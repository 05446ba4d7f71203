// What only a report has: verdict, worst places, histograms, errors over time, step rates, servos, bus lanes, height maps.
function reportSide(app, side) {
  const page = app.page;
  if (!page.report) return;
  const badge = $("verdict-badge");
  const names = page.overlay ? ["SAME", "DIFFERENT"] : ["GO", "NO-GO"];
  badge.textContent = names[page.ok ? 0 : 1];
  badge.className = page.ok ? "go" : "nogo";
  app.state.verdict = badge.textContent;
  const words = page.overlay ? (page.ok ? "the same motion" : "the motion differs") : page.ok ? "GO" + (page.words ? ": " + page.words : "") : "NO-GO";
  side.append(make("div", { id: "verdict" }, make("div", { class: "verdict " + (page.ok ? "go" : "nogo") }, words),
    page.reasons.length ? make("ul", {}, ...page.reasons.map((r) => make("li", {}, r))) : null));
  shifts(app, side);
  worstList(app, side);
  if (page.error_histogram) {
    const box = make("div");
    box.append(make("h2", {}, page.overlay ? "distance of the paths, um" : "contour error, um (shape)"), bars(page.error_histogram, "heat", "pulses"));
    box.append(make("h2", { style: "margin-top:10px" }, "lag, ms (along the path, no error of shape)"), bars(page.lag_histogram, "viridis", "pulses"));
    side.append(box);
  }
  (page.lags || []).forEach((lag) => lagTables(app, side, lag));
  side.append(make("div", {}, make("h2", {}, "verdict"), make("table", {}, ...page.verdict_rows.map(([k, v]) => make("tr", {}, make("td", {}, k), make("td", { class: "num" }, v))))));
  if (page.violations.length) side.append(make("div", {}, make("h2", {}, "violations of the data sheets"), make("table", {}, ...page.violations.map((v) =>
    make("tr", { class: "jump", onclick: () => app.setTime(v.time_s) }, make("td", { class: "num" }, clockText(v.time_s)), make("td", {}, v.module), make("td", {}, v.rule + ": " + v.words))))));
  if ((page.clocks || []).length) side.append(make("div", {}, make("h2", {}, "clocks of the modules"), make("table", {},
    make("tr", {}, ...["", "crystal, ppm", "drift alone, ms"].map((h) => make("th", {}, h))),
    ...page.clocks.map((c) => make("tr", {}, make("td", {}, c.name), make("td", { class: "num" }, (c.crystal_ppm >= 0 ? "+" : "") + c.crystal_ppm.toFixed(1)), make("td", { class: "num" }, c.drift_ms.toFixed(2))))),
    make("div", { class: "hint" }, "what the stream had to correct over the job")));
  if ((page.starts || []).length) {
    const worst = page.starts.reduce((a, b) => (b.skew_ms > a.skew_ms ? b : a)), middle = page.starts.map((x) => x.skew_ms).sort((a, b) => a - b)[page.starts.length >> 1];
    side.append(make("div", {}, make("h2", {}, "start skew"), make("table", {},
      make("tr", {}, make("td", {}, "starts of several motors"), make("td", { class: "num" }, String(page.starts.length))),
      make("tr", {}, make("td", {}, "middle"), make("td", { class: "num" }, middle.toFixed(2) + " ms")),
      make("tr", { class: "jump", onclick: () => app.setTime(worst.time_s) }, make("td", {}, "largest, " + worst.motors.join(" ")), make("td", { class: "num" }, worst.skew_ms.toFixed(2) + " ms")))));
  }
  if (page.digests.length) side.append(make("div", {}, make("h2", {}, "digests"), ...page.digests.map(([k, v]) => make("div", { class: "digest num" }, `${k}  ${v}`)), make("div", { class: "hint" }, `seed ${page.seed}: same program, machine and seed, same digests`)));
}

// Where a motor lost its place: from there on everything is off by so many steps.
function shifts(app, side) {
  const list = app.page.shifts;
  if (!list.length) return;
  side.append(make("div", {}, make("h2", {}, "lost places"), make("table", { id: "shifts" }, ...list.map((s) =>
    make("tr", { class: "jump", onclick: () => { app.keepLine = s.line; app.setTime(s.time_s); } },
      make("td", { class: "num" }, "line " + s.line), make("td", { class: "num" }, clockText(s.time_s)), make("td", {}, `${s.axis} ${s.steps >= 0 ? "+" : ""}${s.steps.toFixed(1)} steps, ${s.um >= 0 ? "+" : ""}${s.um.toFixed(0)} um`))))));
}

// How late each axis is by itself, and the lines that come latest: along the path, then axis by axis.
function lagTables(app, side, lag) {
  const number = (text) => make("td", { class: "num" }, text);
  const row = (cells) => make("tr", {}, ...cells);
  const head = (words) => row(words.map((h) => make("th", {}, h)));
  const names = lag.axes.map((a) => a[0]);
  side.append(make("div", { class: "lags" }, make("h2", {}, lag.what + " by axis and line, ms"),
    make("table", {}, head(["axis", "max", "rms", "worst in line"]),
      ...lag.axes.map(([name, most, rms, line]) => row([make("td", {}, name), number(most.toFixed(2)), number(rms.toFixed(2)), number(String(line))]))),
    make("table", {}, head(["line", "path", ...names]),
      ...lag.lines.map(([line, ...ms]) => row([number(String(line)), ...ms.map((v) => number(v.toFixed(2)))])))));
}

function worstList(app, side) {
  const { worst, axes } = app.page;
  if (!worst.length) return;
  const head = make("tr", {}, ...["line", "time", "um", ...axes.map((a) => "Δ" + a)].map((h) => make("th", {}, h)));
  const rows = worst.map((w, k) => make("tr", { class: "jump", "data-worst": k, title: `lag ${w.lag_ms.toFixed(2)} ms`, onclick: () => { app.keepLine = w.line; app.setTime(w.time_s); } },
    make("td", { class: "num" }, String(w.line)), make("td", { class: "num" }, clockText(w.time_s)), make("td", { class: "num" }, w.error_um.toFixed(1)),
    ...w.offset_um.map((d) => make("td", { class: "num" }, (d >= 0 ? "+" : "") + d.toFixed(1)))));
  const table = make("table", { id: "worst" }, head, ...rows.slice(0, 8));
  const more = rows.length > 8 ? make("button", { onclick: () => { table.append(...rows.slice(8)); more.remove(); } }, `${rows.length - 8} more`) : null;
  side.append(make("div", {}, make("h2", {}, "worst places", make("span", { class: "grow" }), more), table));
  (app.followers ||= []).push((s) => rows.forEach((r, k) => r.classList.toggle("now", Math.abs(worst[k].time_s - s) < 1e-6)));
}

function bars(h, ramp, unit) {
  const canvas = make("canvas", { width: 612, height: 150 }), c = canvas.getContext("2d"), n = h.counts.length, most = Math.log10(Math.max(...h.counts) + 1) || 1, w = 612 / n, map = RAMPS[ramp];
  for (let i = 0; i < n; i++) {
    const tall = Math.log10(h.counts[i] + 1) / most * 112, o = 3 * Math.round(255 * (h.low < 0 ? Math.abs(2 * i / (n - 1) - 1) : i / (n - 1)));
    c.fillStyle = `rgb(${map[o]},${map[o + 1]},${map[o + 2]})`;
    c.fillRect(i * w + .5, 122 - tall, w - 1, tall);
  }
  c.fillStyle = "#8b99a8"; c.font = "20px system-ui, sans-serif";
  for (const [x, align] of [[0, "left"], [.5, "center"], [1, "right"]]) { c.textAlign = align; c.fillText(short(h.low + x * (h.high - h.low)), x * 612, 146); }
  c.textAlign = "left"; c.font = "16px system-ui, sans-serif";
  let row = 14;
  for (const [name, value] of Object.entries(h.marks || {})) {
    const x = (value - h.low) / (h.high - h.low) * 612;
    c.fillRect(x, row - 12, 1.5, 122 - row + 12);
    c.textAlign = x > 420 ? "right" : "left";
    c.fillText(`${name}: ${short(value)}`, x + (x > 420 ? -5 : 5), row); row += 19;
  }
  return make("div", {}, canvas, make("div", { class: "hint" }, `number of ${unit}, logarithmic`));
}

function reportTabs(app) {
  const page = app.page;
  if (!page.report) return [];
  const tabs = [];
  if (page.error_histogram) tabs.push({ id: "error", label: "error", specs: () => errorPlots(app) });
  if (page.rates.length) tabs.push({ id: "rates", label: "step rates", specs: () => page.rates.map((name, k) => ratePlot(app, name, k)) });
  if (page.servos.length) tabs.push({ id: "servo", label: "servos", specs: () => page.servos.flatMap((s, k) => servoPlots(app, s, k)) });
  if (page.bus) tabs.push({ id: "bus", label: "bus", show: (body) => app.lanes && app.lanes.show(body) });
  if (page.zmap) tabs.push({ id: "cut", label: "cut", show: (body) => cutMaps(app, body) });
  return tabs;
}

async function reportData(app) {
  const page = app.page;
  if (!page.report) return;
  app.errors = await blockOf("errors");
  app.rates = []; app.servos = [];
  for (let k = 0; k < page.rates.length; k++) app.rates.push(await blockOf("rate-" + k));
  for (let k = 0; k < page.servos.length; k++) app.servos.push(await blockOf("servo-" + k));
  app.zmap = await blockOf("zmap-data");
  app.sim = await blockOf("sim");
  if (app.sim) {
    for (const key of ["q", "d"]) app.sim[key] = page.xyz.map((k) => (k < 0 ? null : app.sim[key][k]));
    await app.scene.setSim(app.sim, 1);
    const slider = make("select", { id: "exaggerate", title: "how many times the error is drawn", onchange: () => { app.exaggeration = +slider.value; app.scene.layers.sim = true; $("layers").querySelector("[data-layer=sim]").classList.add("on"); app.scene.setSim(app.sim, app.exaggeration); } },
      ...[1, 10, 50, 100, 200, 500].map((n) => make("option", { value: n }, `error ${n}×`)));
    $("layers").append(slider);
  }
  const bus = await blockOf("bus-data");
  if (bus) app.lanes = new Lanes(app, bus);
  app.tab(app.tabNow || "error");
}

function errorPlots(app) {
  const e = app.errors, path = app.path;
  if (!e) return [];
  return [
    { id: "contour", label: app.page.overlay ? "distance" : "contour error", unit: "um", series: [{ label: app.page.overlay ? "farthest of the other motion from this one" : "farthest of the pins from the plan", colour: "#ff6b6b", fill: "rgba(255,107,107,.22)", t: e.t, y: e.error }], range: (u, a, b) => [0, (b || 1) * 1.08] },
    { id: "lag", label: "lag", unit: "ms", series: [{ label: "along the path", colour: "#c38cff", t: e.lag_t, y: e.lag }], range: (u, a, b) => [0, (b || 1) * 1.08] },
    { id: "speed2", label: "speed", unit: "mm/s", series: [{ label: "planned", colour: css("--accent"), t: path.t, y: path.speed }] },
  ];
}

function ratePlot(app, name, k) {
  const r = app.rates[k];
  if (!r) return { id: "rate", label: name, unit: "", series: [] };
  return { id: "rate-" + name, label: name, unit: "steps/s", height: 150, series: [
    { label: "planned", colour: css("--accent"), t: r.planned_s, y: r.planned, width: 2 }, { label: "emitted by the chip", colour: "#ff9f43", t: r.emitted_s, y: r.emitted, step: true, width: 1 }] };
}

function servoPlots(app, servo, k) {
  const s = app.servos[k];
  if (!s) return [];
  const list = [{ id: "following-" + servo.name, label: servo.name + " error", unit: "um", series: [{ label: "following error", colour: "#ff6b6b", t: s.t, y: s.error, width: 1 }] }];
  if (s.pwm) list.push({ id: "pwm-" + servo.name, label: servo.name + " PWM", unit: "share", series: [{ label: "PWM", colour: "#f5d547", t: s.t, y: s.pwm, width: 1, step: true }], range: () => [-1.05, 1.05] });
  return list;
}

// One lane a module: what was on the wire for whom, when; red is what left late. Below: use and slack.
const LANE = 24, LANE_COLOURS = ["#4cc2ff", "#3ddc97", "#5b6875", "#c38cff"];
class Lanes {
  constructor(app, bus) {
    this.app = app; this.bus = bus; this.info = app.page.bus;
    const key = (b, a) => b * 256 + a, rank = new Map(this.info.lanes.map((l, i) => [key(l.bus, l.address), i]));
    this.lane = Uint8Array.from(bus.bus, (b, i) => rank.get(key(b, bus.address[i])) ?? 0);
    (app.onZoom ||= []).push(() => this.draw());
    (app.followers ||= []).push(() => this.mark());
  }
  show(body) {
    const i = this.info, canvas = this.canvas = make("canvas", { height: LANE * i.lanes.length + 24 }), cursor = this.cursor = make("div", { class: "cursor-line" });
    const words = `${i.exchanges.toLocaleString("en")} exchanges, ${i.late} late; least slack ${i.least_slack_ms.toFixed(2)} ms, latest ${i.latest_ms.toFixed(2)} ms after its time. ` +
      "Blue: loads, green: group Start, grey: questions, violet: the rest, red: left late. Wheel: zoom, click: go there.";
    body.append(make("div", { class: "hint" }, words), make("div", { class: "lanes" }, canvas, cursor));
    canvas.addEventListener("click", (e) => this.app.setTime(this.timeAt(e)));
    canvas.addEventListener("wheel", (e) => { e.preventDefault(); const p = this.app.plots, at = this.timeAt(e), f = e.deltaY > 0 ? 1.4 : 1 / 1.4; p.zoom(at - (at - p.from) * f, at + (p.to - at) * f); }, { passive: false });
    this.charts(body);
    this.draw();
  }
  charts(body) {
    const host = make("div"), b = this.bus, plots = this.app.plots;
    body.append(host);
    const keep = plots.body;
    plots.body = host;
    plots.show([
      { id: "bus-use", label: "bus use", unit: "share", series: [{ label: "of the wire's time", colour: "#4cc2ff", fill: "rgba(76,194,255,.2)", t: b.use_t, y: b.use }], range: () => [0, 1.03] },
      { id: "slack", label: "slack", unit: "ms", series: [{ label: "free before each exchange", colour: "#3ddc97", t: b.begin, y: b.slack, width: 1 }, { label: "left late", colour: "#ff6b6b", t: b.begin, y: b.late }] },
    ]);
    plots.body = keep;
  }
  left() { return 96; }
  timeAt(e) { const box = this.canvas.getBoundingClientRect(), p = this.app.plots; return p.from + (e.clientX - box.left - this.left()) / (box.width - this.left() - 8) * (p.to - p.from); }
  mark() {
    if (!this.canvas || !this.canvas.isConnected) return;
    const p = this.app.plots, w = this.canvas.clientWidth, x = this.left() + (this.app.now - p.from) / (p.to - p.from) * (w - this.left() - 8);
    this.cursor.style.left = x + "px"; this.cursor.style.display = x >= this.left() && x <= w ? "" : "none";
  }
  draw() {
    const canvas = this.canvas;
    if (!canvas || !canvas.isConnected) return;
    const w = canvas.width = Math.max(canvas.clientWidth, 300), h = canvas.height, c = canvas.getContext("2d"), { begin, span, kind, late } = this.bus, p = this.app.plots, l = this.left(), lanes = this.info.lanes;
    const scale = (w - l - 8) / (p.to - p.from);
    c.clearRect(0, 0, w, h);
    c.font = "11px system-ui, sans-serif";
    lanes.forEach((lane, k) => { c.fillStyle = k % 2 ? css("--panel") : css("--raised"); c.fillRect(l, k * LANE, w - l - 8, LANE - 2); c.fillStyle = css("--soft"); c.fillText(lane.name, 2, k * LANE + 15); });
    const first = Math.max(lastAtOrBefore(begin, p.from) - 1, 0), last = Math.min(lastAtOrBefore(begin, p.to) + 1, begin.length);
    if (last - first > 20000) this.dense(c, first, last, scale, l, w - l - 8);
    else for (let i = first; i < last; i++) {
      const x = l + (begin[i] - p.from) * scale, wide = Math.max(span[i] * scale, .8);
      if (x + wide < l) continue;
      c.fillStyle = late[i] > 0 ? "#ff4d4d" : LANE_COLOURS[kind[i]];
      c.fillRect(x, this.lane[i] * LANE + 3, wide, LANE - 8);
    }
    c.fillStyle = css("--soft");
    for (let k = 0; k <= 5; k++) { c.textAlign = k === 5 ? "right" : k ? "center" : "left"; c.fillText((p.from + k / 5 * (p.to - p.from)).toFixed(p.to - p.from < 1 ? 3 : p.to - p.from < 20 ? 2 : 1) + " s", l + k / 5 * (w - l - 8), h - 6); }
    c.textAlign = "left";
    this.mark();
  }
  // Too many to draw each: the share of every pixel, late ones always shown.
  dense(c, first, last, scale, l, wide) {
    const lanes = this.info.lanes.length, busy = new Float32Array(lanes * (wide + 1)), { begin, span, late } = this.bus, from = this.app.plots.from, red = new Set();
    for (let i = first; i < last; i++) {
      const x = Math.floor((begin[i] - from) * scale);
      if (x < 0 || x > wide) continue;
      busy[this.lane[i] * (wide + 1) + x] += span[i] * scale;
      if (late[i] > 0) red.add(this.lane[i] * (wide + 1) + x);
    }
    for (let k = 0; k < lanes; k++) for (let x = 0; x < wide; x++) {
      const at = k * (wide + 1) + x, share = busy[at];
      if (!share) continue;
      c.globalAlpha = red.has(at) ? 1 : .25 + .75 * Math.min(share, 1);
      c.fillStyle = red.has(at) ? "#ff4d4d" : LANE_COLOURS[0];
      c.fillRect(l + x, k * LANE + 3, 1, LANE - 8);
    }
    c.globalAlpha = 1;
  }
}

function cutMaps(app, body) {
  const z = app.page.zmap, data = app.zmap;
  if (!data) return;
  const { rows, columns } = z, low = minMax(data.planned)[0], worst = z.scale_um;
  const height = (values) => (i) => shareOf({ low, high: z.top_mm, log: false }, values[i]);
  const figures = [
    ["planned cut, mm", "viridis", height(data.planned), `${low.toFixed(2)} … ${z.top_mm.toFixed(2)}`],
    ["simulated cut, mm", "viridis", height(data.simulated), ""],
    ["simulated over planned, um", "warm", (i) => Math.min(Math.max(.5 + .5 * data.difference[i] / worst, 0), 1), `blue: ${short(z.excess_mm3)} mm³ too much cut, red: ${short(z.left_mm3)} mm³ left standing; full colour at ${short(worst)} um`],
  ];
  const row = make("div", { class: "maps" });
  const tall = Math.max(Math.min(body.clientHeight - 56, 420), 160), wide = Math.min(tall * columns / rows, (body.clientWidth - 60) / 3);
  for (const [title, ramp, share, note] of figures) {
    const canvas = make("canvas", { width: columns, height: rows, style: `width:${wide}px` }), c = canvas.getContext("2d"), image = c.createImageData(columns, rows), map = RAMPS[ramp];
    for (let r = 0; r < rows; r++) for (let k = 0; k < columns; k++) {
      const o = 3 * Math.round(255 * share(r * columns + k)), p = 4 * ((rows - 1 - r) * columns + k);
      image.data[p] = map[o]; image.data[p + 1] = map[o + 1]; image.data[p + 2] = map[o + 2]; image.data[p + 3] = 255;
    }
    c.putImageData(image, 0, 0);
    row.append(make("figure", {}, make("figcaption", { style: `max-width:${Math.max(wide, 180)}px` }, title + (note ? " – " + note : "")), canvas));
  }
  body.append(row, make("div", { class: "hint" }, `flat end of ${z.diameter_mm} mm, cells of ${(1e3 * z.cell_mm).toFixed(0)} um`));
}
function minMax(values) { let a = Infinity, b = -Infinity; for (const v of values) { if (v < a) a = v; if (v > b) b = v; } return [a, b]; }
