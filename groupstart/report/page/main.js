// Everything hangs on one time: slider, play, program line, tool, plots, bus lanes and worst places follow it.
const RATES = [0.1, 0.25, 1, 2, 5, 10, 20, 50, 100];

class Page {
  constructor(page) {
    this.page = page; this.now = 0; this.rate = 1; this.playing = false; this.ready = false; this.tabs = [];
    $("job").textContent = page.job;
    $("subtitle").textContent = page.subtitle;
    document.title = `${page.job} – groupstart`;
    const slider = $("time");
    slider.max = page.duration_s;
    slider.addEventListener("input", () => this.setTime(+slider.value));
    $("play").addEventListener("click", () => this.play(!this.playing));
    for (const r of RATES) $("rate").append(make("option", { value: r, selected: r === 1 }, r + "×"));
    $("rate").addEventListener("change", () => { this.rate = +$("rate").value; });
    $("theme").addEventListener("click", () => this.theme());
    $("zoom-out").addEventListener("click", () => this.plots.zoom(0, page.duration_s));
    addEventListener("keydown", (e) => this.key(e));
    for (const split of document.querySelectorAll(".split")) splitter(split);
    this.plots = new Plots($("lower-body"), page.duration_s, (s) => this.setTime(s), () => this.zoomed());
    this.program = new Program((line) => this.toLine(line));
  }

  async start() {
    const page = this.page, T = await three(), scene = this.scene = new Scene(T, page, $("scene"));
    this.viewButtons();
    this.path = this.prepared(await blockOf("path0"));
    this.modes = modesOf(page, this.path);
    await scene.setPath(this.path);
    const side = $("side");
    reportSide(this, side);
    const host = make("div");
    side.append(host);
    if (page.report && side.children.length > 1) side.insertBefore(host, side.children[1]); else side.prepend(host);
    this.legend = new Legend(host, this.modes, this.path, (m, s, b) => { scene.brush = b; this.state.mode = m.id; scene.setMode(m, s); });
    this.legend.set(page.report ? "error" : "speed");
    facts(side, page);
    this.state.first_picture_ms = performance.now();
    this.passes = await blockOf("passes");
    await this.program.load(await textOf("program-text"));
    await this.firstPasses();
    this.tabs = [{ id: "motion", label: "motion", specs: () => motionPlots(this) }, ...reportTabs(this)];
    $("tabs").append(...this.tabs.map((t) => make("button", { "data-tab": t.id, onclick: () => this.tab(t.id) }, t.label)));
    this.setTime(0);
    this.tab(page.first_tab || "motion");
    await reportData(this);
    await this.finer();
    this.ready = this.state.ready = true;
    this.state.ready_ms = performance.now();
  }

  get state() { return (window.__state ||= {}); }

  prepared(path) {
    path.length = path.t.length;
    const zero = new Float64Array(path.t.length);
    path.xyz = this.page.xyz.map((k) => (k < 0 ? zero : path.q[k]));
    return path;
  }

  // The finer path of a long program comes when everything else stands.
  async finer() {
    const fine = await blockOf("path1");
    if (!fine) return;
    await breath();
    this.path = this.prepared(fine);
    this.modes = modesOf(this.page, this.path);
    await breath();
    await this.scene.setPath(this.path);
    const id = this.legend.mode.id;
    this.legend.setModes(this.modes, this.path);
    await breath();
    this.legend.set(id);
    await breath();
    this.tab(this.tabNow);
  }

  // First time of each line, for jumps from the text.
  async firstPasses() {
    const { pass_s, pass_line } = this.passes, most = this.program.count, first = new Float64Array(most + 2).fill(-1);
    for (let i = pass_line.length - 1; i >= 0; i--) if (pass_line[i] <= most) first[pass_line[i]] = pass_s[i];
    await breath();
    for (let n = most - 1; n > 0; n--) if (first[n] < 0) first[n] = first[n + 1];
    this.first = first;
  }
  toLine(line) { const s = this.first[line]; this.program.select(line); if (s >= 0) { this.keepLine = line; this.setTime(s); } }
  lineAt(s) { const i = lastAtOrBefore(this.passes.pass_s, s); return this.passes.pass_line[Math.max(i, 0)]; }

  setTime(s) {
    s = this.now = Math.min(Math.max(s, 0), this.page.duration_s);
    $("time").value = s;
    $("clock").textContent = `${clockText(s)} / ${clockText(this.page.duration_s)}`;
    const i = this.scene.setTime(s), path = this.path, line = this.keepLine || (this.passes ? this.lineAt(s) : 0);
    this.keepLine = 0;
    this.plots.setTime(s);
    this.program.select(line);
    const span = path.t[i + 1] - path.t[i], f = span > 0 ? Math.min(Math.max((s - path.t[i]) / span, 0), 1) : 0;
    const words = this.page.axes.map((axis, k) => `${axis} ${(path.q[k][i] + f * (path.q[k][i + 1] - path.q[k][i])).toFixed(3).padStart(9)}`);
    const speed = path.speed[i] + f * (path.speed[i + 1] - path.speed[i]), feed = path.feed[i];
    words.push(`speed ${speed.toFixed(2)} mm/s` + (feed ? ` of ${+feed.toFixed(3)}` : path.kind[i] === 1 ? ", rapid" : ""), `limit  ${this.page.causes[path.cause[i]]}`);
    if (path.error) words.push(`error ${path.error[i].toFixed(2)} um   lag ${path.lag[i].toFixed(2)} ms`);
    $("readout").textContent = words.join("\n");
    Object.assign(this.state, { time_s: s, line, stretch: i, tool: this.scene.tool.position.toArray(), speed_mm_s: speed });
    for (const follow of this.followers || []) follow(s, line);
  }

  play(on) {
    this.playing = on;
    $("play").textContent = on ? "❚❚" : "▶";
    if (!on) return;
    if (this.now >= this.page.duration_s) this.setTime(0);
    let last = performance.now();
    const step = (now) => {
      if (!this.playing) return;
      this.setTime(this.now + (now - last) * 1e-3 * this.rate);
      last = now;
      if (this.now >= this.page.duration_s) this.play(false); else requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
  }

  key(e) {
    if (/^(SELECT|TEXTAREA)$/.test(e.target.tagName) || e.ctrlKey || e.metaKey || e.altKey) return;
    const step = (e.shiftKey ? .05 : .005) * (this.plots.to - this.plots.from);
    if (e.key === " ") { e.preventDefault(); this.play(!this.playing); }
    else if (e.key === "ArrowRight" && e.target.tagName !== "INPUT") this.setTime(this.now + step);
    else if (e.key === "ArrowLeft" && e.target.tagName !== "INPUT") this.setTime(this.now - step);
    else if (e.key === "Home") this.setTime(0);
    else if (e.key === "End") this.setTime(this.page.duration_s);
  }

  viewButtons() {
    const scene = this.scene;
    for (const v of ["iso", "top", "front", "right"]) $("views").append(make("button", { "data-view": v, onclick: () => scene.look(v) }, v));
    const layers = [["rapids", "rapids"], ["limits", "soft limits"], ["bounds", "bounds"], ["grid", "grid"], ["ahead", "what is ahead"]];
    if (this.page.report) layers.push(["sim", this.page.overlay ? "the other" : "simulated"]);
    for (const [id, label] of layers) {
      const b = make("button", { class: scene.layers[id] ? "on" : "", "data-layer": id, onclick: () => { scene.layers[id] = !scene.layers[id]; b.classList.toggle("on", scene.layers[id]); scene.apply(); scene.setTime(this.now); } }, label);
      $("layers").append(b);
    }
    $("view-note").textContent = "turn: left, move: right, zoom: wheel, click the path: go there";
    const canvas = $("scene");
    let down = null;
    canvas.addEventListener("pointerdown", (e) => { down = [e.clientX, e.clientY]; });
    canvas.addEventListener("pointerup", (e) => {
      if (!down || Math.hypot(e.clientX - down[0], e.clientY - down[1]) > 4) return;
      const box = canvas.getBoundingClientRect(), at = scene.pick(e.clientX - box.left, e.clientY - box.top);
      if (at >= 0) { const i = Math.floor(at), t = this.path.t; this.setTime(t[i] + (at - i) * ((t[i + 1] ?? t[i]) - t[i])); }
    });
  }

  tab(id) {
    this.tabNow = id;
    for (const b of $("tabs").children) b.classList.toggle("on", b.dataset.tab === id);
    const tab = this.tabs.find((t) => t.id === id) || this.tabs[0];
    $("zoom-out").style.display = tab.specs ? "" : "none";
    if (tab.specs) this.plots.show(tab.specs()); else { this.plots.show([]); tab.show($("lower-body")); }
    this.zoomed();
  }
  zoomed() {
    const p = this.plots;
    $("plot-note").textContent = p.from > 0 || p.to < this.page.duration_s ? `${clockText(p.from)} to ${clockText(p.to)}` : "drag to zoom, click to go there";
    for (const f of this.onZoom || []) f();
  }

  theme() {
    document.documentElement.classList.toggle("light");
    this.scene.furniture();
    this.scene.setMode(this.legend.mode, this.legend.spread);
    this.legend.paint();
    this.tab(this.tabNow);
    if (this.sim) this.scene.setSim(this.sim, this.exaggeration || 1);
  }
}

function motionPlots(p) {
  const { path, page } = p, t = path.t, list = [];
  const feed = new Float32Array(t.length);
  for (let i = 0; i < t.length; i++) feed[i] = path.feed[Math.min(i, path.feed.length - 1)] || NaN;
  list.push({ id: "speed", label: "speed", unit: "mm/s", series: [
    { label: "programmed", colour: css("--faint"), t, y: feed, step: true, dash: [4, 3] }, { label: "planned", colour: css("--accent"), t, y: path.speed }] });
  list.push({ id: "position", label: "position", unit: "mm", series: page.axes.map((a, k) => ({ label: a, colour: KINDS[k + 1], t, y: path.q[k] })) });
  list.push({ id: "velocity", label: "velocity", unit: "mm/s", series: page.axes.map((a, k) => ({ label: a, colour: KINDS[k + 1], t, y: path.v[k] })) });
  list.push({ id: "accel", label: "acceleration", unit: "mm/s²", series: [{ label: "path", colour: "#ff9f1c", t, y: path.accel, step: true }] });
  if (page.has_jerk) list.push({ id: "jerk", label: "jerk", unit: "mm/s³", series: [{ label: "path", colour: "#f3722c", t, y: path.jerk, step: true }] });
  return list;
}

function facts(side, page) {
  const table = make("table", {}, make("tr", {}, ...["", "least", "greatest", "soft limits"].map((h) => make("th", {}, h))));
  for (const b of page.bounds) {
    const row = make("tr", {}, make("td", {}, b.axis), ...[b.least, b.greatest].map((v) => make("td", { class: "num" }, v.toFixed(3))), make("td", { class: "num" }, b.travel ? `${b.travel[0]} … ${b.travel[1]}` : "–"));
    if (b.travel && (b.least < b.travel[0] - 1e-9 || b.greatest > b.travel[1] + 1e-9)) row.style.color = "var(--bad)";
    table.append(row);
  }
  const list = make("table", {}, ...page.facts.map(([k, v]) => make("tr", {}, make("td", {}, k), make("td", { class: "num" }, v))));
  side.append(make("div", {}, make("h2", {}, "program"), list), make("div", {}, make("h2", {}, "bounds, machine mm"), table));
}

function splitter(split) {
  split.addEventListener("pointerdown", (e) => {
    const target = $(split.dataset.target), from = e.clientX, width = target.offsetWidth, way = split.dataset.side === "left" ? 1 : -1;
    split.setPointerCapture(e.pointerId);
    const move = (m) => { target.style.width = Math.min(Math.max(width + way * (m.clientX - from), 120), innerWidth * .6) + "px"; };
    split.addEventListener("pointermove", move);
    split.addEventListener("pointerup", () => split.removeEventListener("pointermove", move), { once: true });
  });
}

// three.js from the page itself: each published file becomes a module of its own.
async function three() {
  const made = {};
  for (const { id, file } of jsonOf("three-files")) {
    let text = new TextDecoder().decode(await textOf(id));
    text = text.replace(/(from\s*|import\s*)(['"])([^'"]+)\2/g, (all, word, quote, name) => { const url = made[name === "three" ? "three.module.js" : name.replace(/^.*\//, "")]; return url ? word + quote + url + quote : all; });
    made[file] = URL.createObjectURL(new Blob([text], { type: "text/javascript" }));
  }
  const out = {};
  for (const file of Object.keys(made)) if (file !== "three.core.js") Object.assign(out, await import(made[file]));
  return out;
}

window.addEventListener("error", (e) => fatal(e.message));
window.addEventListener("unhandledrejection", (e) => fatal(String(e.reason && e.reason.message || e.reason)));
function fatal(words) { (window.__state ||= {}).fault = words; document.body.append(make("div", { id: "fatal" }, "this page failed: " + words)); }

const app = window.groupstart = new Page(jsonOf("page"));
await app.start();
