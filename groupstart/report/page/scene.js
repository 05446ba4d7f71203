// The path in space. Feeds are coloured, rapids stand apart, thin and dashed; drawn only when something changed.
const FAT_FROM = 60000;    // up to so many stretches the path is drawn in wide lines
const CHUNK = 50000;

class Scene {
  constructor(T, page, canvas) {
    this.T = T; this.page = page; this.canvas = canvas;
    T.ColorManagement.enabled = false;
    this.renderer = new T.WebGLRenderer({ canvas, antialias: true, preserveDrawingBuffer: true });
    this.renderer.outputColorSpace = T.LinearSRGBColorSpace;
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio || 1, 2));
    this.world = new T.Scene();
    this.camera = new T.PerspectiveCamera(32, 1, 0.1, 1e5);
    this.camera.up.set(0, 0, 1);
    this.controls = new T.OrbitControls(this.camera, canvas);
    this.controls.zoomToCursor = true;
    this.controls.addEventListener("change", () => this.touch());
    this.layers = { rapids: true, limits: true, bounds: true, grid: true, ahead: true, sim: false };
    this.brush = { low: 0, high: 1, off: new Set() };
    this.frames = 0;
    this.resized = new ResizeObserver(() => this.fitCanvas());
    this.resized.observe(canvas.parentElement);
    this.low = new T.Vector3(...page.low); this.high = new T.Vector3(...page.high);
    this.size = Math.max(this.high.distanceTo(this.low), 1);
    this.furniture();
    this.fitCanvas();
    this.look("iso");
  }

  fitCanvas() {
    const box = this.canvas.parentElement.getBoundingClientRect();
    if (!box.width || !box.height) return;
    this.renderer.setSize(box.width, box.height, false);
    this.camera.aspect = box.width / box.height;
    this.camera.updateProjectionMatrix();
    for (const m of [this.feedMaterial, this.rapidMaterial, this.simMaterial]) if (m && m.resolution) m.resolution.set(box.width, box.height);
    this.touch();
  }

  touch() { if (!this.asked) { this.asked = true; requestAnimationFrame(() => this.draw()); } }
  draw() { this.asked = false; this.frames++; this.renderer.render(this.world, this.camera); }

  look(name) {
    const way = { iso: [-.55, -1.1, .85], top: [0, -1e-4, 1], front: [0, -1, 1e-4], right: [1, 0, 1e-4] }[name];
    const centre = this.low.clone().add(this.high).multiplyScalar(.5), T = this.T;
    const out = new T.Vector3(...way).normalize(), right = new T.Vector3().crossVectors(new T.Vector3(0, 0, 1), out).normalize();
    const up = new T.Vector3().crossVectors(out, right), tan = Math.tan(this.camera.fov * Math.PI / 360);
    let distance = 0;   // far enough for every corner of the bounds
    for (let c = 0; c < 8; c++) {
      const d = new T.Vector3(c & 1 ? this.high.x : this.low.x, c & 2 ? this.high.y : this.low.y, c & 4 ? this.high.z : this.low.z).sub(centre);
      distance = Math.max(distance, d.dot(out) + Math.abs(d.dot(right)) / (tan * Math.max(this.camera.aspect, .2)), d.dot(out) + Math.abs(d.dot(up)) / tan);
    }
    this.camera.position.copy(centre).addScaledVector(out, Math.max(distance * 1.14, 1));
    this.camera.near = distance / 500; this.camera.far = distance * 100 + this.size * 10;
    this.camera.updateProjectionMatrix();
    this.controls.target.copy(centre);
    this.controls.update();
    this.touch();
  }

  box(low, high, colour, dashed) {
    const T = this.T, p = [], x = [low[0], high[0]], y = [low[1], high[1]], z = [low[2], high[2]];
    for (const a of [0, 1]) for (const b of [0, 1]) p.push(x[0], y[a], z[b], x[1], y[a], z[b], x[a], y[0], z[b], x[a], y[1], z[b], x[a], y[b], z[0], x[a], y[b], z[1]);
    const g = new T.BufferGeometry(); g.setAttribute("position", new T.Float32BufferAttribute(p, 3));
    const m = dashed ? new T.LineDashedMaterial({ color: colour, dashSize: this.size / 60, gapSize: this.size / 90, transparent: true, opacity: .42 })
      : new T.LineBasicMaterial({ color: colour, transparent: true, opacity: .55 });
    const l = new T.LineSegments(g, m); if (dashed) l.computeLineDistances();
    return l;
  }

  // Grid, bounds, soft limits, work zero, tool.
  furniture() {
    const T = this.T, page = this.page, s = this.size;
    if (this.fixed) this.world.remove(this.fixed);
    this.world.background = new T.Color(css("--scene"));
    const g = this.fixed = new T.Group(), light = document.documentElement.classList.contains("light");
    const step = Math.pow(10, Math.floor(Math.log10(s / 4))), lines = [], low = page.low, high = page.high;
    const x0 = Math.floor(low[0] / step - 1) * step, x1 = Math.ceil(high[0] / step + 1) * step;
    const y0 = Math.floor(low[1] / step - 1) * step, y1 = Math.ceil(high[1] / step + 1) * step, z = page.floor;
    for (let x = x0; x <= x1 + step / 2; x += step) lines.push(x, y0, z, x, y1, z);
    for (let y = y0; y <= y1 + step / 2; y += step) lines.push(x0, y, z, x1, y, z);
    const gg = new T.BufferGeometry(); gg.setAttribute("position", new T.Float32BufferAttribute(lines, 3));
    this.grid = new T.LineSegments(gg, new T.LineBasicMaterial({ color: light ? 0xd7dee6 : 0x1d2731 }));
    this.bounds = this.box(low, high, light ? 0x6d8299 : 0x6d8299, false);
    g.add(this.grid, this.bounds);
    this.limits = new T.Group();
    if (page.travel) this.limits.add(this.box(page.travel[0], page.travel[1], light ? 0xc76b00 : 0xffb454, true));
    g.add(this.limits);
    const zero = new T.Group(), arm = s * .09;
    [[0xff6b6b, [1, 0, 0]], [0x3ddc97, [0, 1, 0]], [0x4c9dff, [0, 0, 1]]].forEach(([c, d]) =>
      zero.add(new T.ArrowHelper(new T.Vector3(...d), new T.Vector3(), arm, c, arm * .26, arm * .13)));
    zero.position.set(...page.work_zero);
    g.add(zero);
    if (!this.tool) {
      const r = Math.min(s * .012, 3), h = r * 5;
      const cone = new T.Mesh(new T.ConeGeometry(r, h * .5, 24), new T.MeshBasicMaterial({ color: 0xff4fd8, transparent: true, opacity: .92 }));
      cone.rotation.x = -Math.PI / 2; cone.position.z = h * .25;
      const shank = new T.Mesh(new T.CylinderGeometry(r, r, h, 24), new T.MeshBasicMaterial({ color: 0xff9bea, transparent: true, opacity: .55 }));
      shank.rotation.x = Math.PI / 2; shank.position.z = h * .5 + h / 2;
      this.tool = new T.Group(); this.tool.add(cone, shank);
      this.world.add(this.tool);
    }
    this.world.add(g);
    this.apply();
  }

  apply() {
    const on = this.layers;
    this.grid.visible = on.grid; this.bounds.visible = on.bounds; this.limits.visible = on.limits;
    if (this.rapids) this.rapids.visible = on.rapids;
    if (this.sim) this.sim.visible = on.sim;
    this.touch();
  }

  async segments(count, position, fat, width, colour) {
    const T = this.T;
    if (fat) {
      const geometry = new T.LineSegmentsGeometry();
      geometry.setPositions(position);
      const material = new T.LineMaterial({ linewidth: width, vertexColors: colour == null, ...(colour == null ? {} : { color: colour }) });
      const object = new T.LineSegments2(geometry, material);
      object.frustumCulled = false;
      return object;
    }
    const geometry = new T.BufferGeometry();
    geometry.setAttribute("position", new T.BufferAttribute(position, 3));
    const material = new T.LineBasicMaterial(colour == null ? { vertexColors: true } : { color: colour });
    const object = new T.LineSegments(geometry, material);
    object.frustumCulled = false;
    return object;
  }

  // The planned path; replaces the one that is shown.
  async setPath(path) {
    const n = path.feed.length, feeds = [], rapids = [], [x, y, z] = path.xyz;
    for (let i = 0; i < n; i++) if (path.kind[i] === 0) feeds.push(i); else if (path.kind[i] === 1) rapids.push(i);
    const place = async (index) => {
      const out = new Float32Array(6 * index.length);
      for (let k = 0; k < index.length; k++) {
        const i = index[k], o = 6 * k;
        out[o] = x[i]; out[o + 1] = y[i]; out[o + 2] = z[i]; out[o + 3] = x[i + 1]; out[o + 4] = y[i + 1]; out[o + 5] = z[i + 1];
        if (k % CHUNK === CHUNK - 1) await breath();
      }
      return out;
    };
    const fat = n <= FAT_FROM, feed = await this.segments(feeds.length, await place(feeds), fat, 2.4, null);
    const rapid = new this.T.LineSegments(new this.T.BufferGeometry(), new this.T.LineDashedMaterial({ color: 0x8593a3, dashSize: this.size / 120, gapSize: this.size / 150, transparent: true, opacity: .6 }));
    rapid.geometry.setAttribute("position", new this.T.BufferAttribute(await place(rapids), 3));
    if (rapids.length <= FAT_FROM) rapid.computeLineDistances();
    rapid.frustumCulled = false;
    for (const old of [this.feed, this.rapids]) if (old) { this.world.remove(old); old.geometry.dispose(); old.material.dispose(); }
    this.path = path; this.feedIndex = Uint32Array.from(feeds); this.feed = feed; this.rapids = rapid; this.fat = fat;
    this.feedMaterial = fat ? feed.material : null;
    this.colour = null;
    if (this.mode) await this.setMode(this.mode, this.spread);
    this.world.add(feed, rapid);
    this.fitCanvas();
    this.apply();
    this.setTime(this.now || 0);
  }

  async setMode(mode, spread) {
    this.mode = mode; this.spread = spread;
    const path = this.path, index = this.feedIndex, turn = (this.turn = (this.turn || 0) + 1), light = document.documentElement.classList.contains("light");
    const faded = light ? [222, 228, 234] : [34, 42, 50], none = [120, 130, 140];
    const out = new Float32Array(6 * index.length);
    for (let k = 0; k < index.length; k += CHUNK) {
      colourInto(out, mode, spread, this.brush, index, k, Math.min(k + CHUNK, index.length), faded, none);
      if (k + CHUNK < index.length) { await breath(); if (turn !== this.turn) return; }
    }
    if (turn !== this.turn || path !== this.path) return;
    this.colour = out;
    if (this.fat) this.feed.geometry.setColors(out);
    else this.feed.geometry.setAttribute("color", new this.T.BufferAttribute(out, 3));
    this.touch();
  }

  // Where the pins went, drawn as the planned place plus the error, that many times as large.
  async setSim(sim, times) {
    if (!sim) return;
    const n = sim.t.length, position = new Float32Array(6 * Math.max(n - 1, 0)), at = (k, i) => sim.q[k][i] + times * sim.d[k][i];
    for (let i = 0; i < n - 1; i++) {
      const o = 6 * i;
      for (let k = 0; k < 3; k++) { position[o + k] = sim.q[k] ? at(k, i) : 0; position[o + 3 + k] = sim.q[k] ? at(k, i + 1) : 0; }
      if (i % CHUNK === CHUNK - 1) await breath();
    }
    const light = document.documentElement.classList.contains("light");
    const fresh = await this.segments(n - 1, position, n <= FAT_FROM, 1.1, light ? 0x111111 : 0xffffff);
    fresh.renderOrder = 2;
    if (this.sim) { this.world.remove(this.sim); this.sim.geometry.dispose(); }
    this.sim = fresh; this.simMaterial = fresh.material.resolution ? fresh.material : null;
    this.world.add(fresh);
    this.fitCanvas();
    this.apply();
  }

  setTime(s) {
    this.now = s;
    const path = this.path;
    if (!path) return;
    const i = Math.max(0, Math.min(lastAtOrBefore(path.t, s), path.t.length - 2)), span = path.t[i + 1] - path.t[i];
    const f = span > 0 ? Math.min(Math.max((s - path.t[i]) / span, 0), 1) : 0;
    const at = path.xyz.map((c) => c[i] + f * (c[i + 1] - c[i]));
    this.tool.position.set(...at);
    if (this.feed) {
      const shown = this.layers.ahead ? this.feedIndex.length : lastAtOrBefore(this.feedIndex, i) + 1;
      if (this.fat) this.feed.geometry.instanceCount = shown; else this.feed.geometry.setDrawRange(0, 2 * shown);
    }
    this.stretch = i;
    this.touch();
    return i;
  }

  // The stretch under a point of the canvas, or -1.
  pick(px, py) {
    const path = this.path, box = this.canvas.getBoundingClientRect(), v = new this.T.Vector3(), m = new this.T.Matrix4();
    m.multiplyMatrices(this.camera.projectionMatrix, this.camera.matrixWorldInverse);
    const e = m.elements, [x, y, z] = path.xyz, n = path.t.length;
    let best = 12 * 12, found = -1, ax = 0, ay = 0, ok = false;
    for (let i = 0; i < n; i++) {
      const w = e[3] * x[i] + e[7] * y[i] + e[11] * z[i] + e[15];
      const sx = ((e[0] * x[i] + e[4] * y[i] + e[8] * z[i] + e[12]) / w + 1) * box.width / 2;
      const sy = (1 - (e[1] * x[i] + e[5] * y[i] + e[9] * z[i] + e[13]) / w) * box.height / 2;
      if (ok && w > 0) {
        const ex = sx - ax, ey = sy - ay, l = ex * ex + ey * ey, u = l ? Math.min(Math.max(((px - ax) * ex + (py - ay) * ey) / l, 0), 1) : 0;
        const d = (px - ax - u * ex) ** 2 + (py - ay - u * ey) ** 2;
        if (d < best) { best = d; found = i - 1 + u; }
      }
      ax = sx; ay = sy; ok = w > 0;
    }
    return found;
  }
}
