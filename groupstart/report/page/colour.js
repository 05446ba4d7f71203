// Colour scales: sequences for quantities, lists for kinds. A scale is 256 colours, three bytes each.
const VIRIDIS = ["#440154", "#482878", "#3e4989", "#31688e", "#26828e", "#1f9e89", "#35b779", "#6ece58", "#b5de2b", "#fde725"];
const HEAT = ["#1b2a4a", "#1f5a8c", "#2a9d8f", "#8ac926", "#ffd166", "#ff9f1c", "#f3722c", "#e63946", "#c9184a", "#ff4d9d"];
const WARM = ["#3b4cc0", "#6788ee", "#9abbff", "#c9d7f0", "#edd1c2", "#f7a889", "#e26952", "#b40426"];
const KINDS = ["#7a8794", "#4cc2ff", "#ff9f43", "#ff6b6b", "#c38cff", "#3ddc97", "#f5d547", "#ff8ad4", "#6be5d8", "#b8e986", "#d0a16b", "#9aa6ff", "#e6e6e6"];

function rgb(hex) { const n = parseInt(hex.slice(1), 16); return [n >> 16, (n >> 8) & 255, n & 255]; }

function ramp(stops) {
  const out = new Uint8Array(768), points = stops.map(rgb);
  for (let i = 0; i < 256; i++) {
    const x = (i / 255) * (points.length - 1), k = Math.min(Math.floor(x), points.length - 2), f = x - k;
    for (let c = 0; c < 3; c++) out[3 * i + c] = points[k][c] + f * (points[k + 1][c] - points[k][c]);
  }
  return out;
}
const RAMPS = { viridis: ramp(VIRIDIS), heat: ramp(HEAT), warm: ramp(WARM) };

// What the path may be coloured by. Each mode gives a value at both ends of stretch i, or a kind.
function modesOf(page, path) {
  const n = path.feed.length, axes = path.q.length, linear = page.linear;
  const speed = new Float32Array(n + 1);
  for (let i = 0; i <= n; i++) {
    let sum = 0;
    for (const k of linear) sum += path.v[k][i] * path.v[k][i];
    speed[i] = Math.sqrt(sum);
    if (speed[i] === 0 && linear.length < axes) for (let k = 0; k < axes; k++) speed[i] = Math.max(speed[i], Math.abs(path.v[k][i]));
  }
  path.speed = speed;
  const both = (f) => ({ at: (i) => f(i), end: (i) => f(i) });
  const modes = [
    { id: "speed", label: "actual speed", unit: "mm/s", ramp: "viridis", at: (i) => speed[i], end: (i) => speed[i + 1] },
    { id: "feed", label: "programmed feed", unit: "mm/s", ramp: "viridis", ...both((i) => path.feed[i] || NaN) },
    { id: "ratio", label: "speed / feed", unit: "", ramp: "warm", low: 0, high: 1,
      at: (i) => path.feed[i] ? Math.min(speed[i] / path.feed[i], 1) : NaN, end: (i) => path.feed[i] ? Math.min(speed[i + 1] / path.feed[i], 1) : NaN },
    { id: "accel", label: "acceleration", unit: "mm/s²", ramp: "heat", ...both((i) => path.accel[i]) },
  ];
  if (page.has_jerk) modes.push({ id: "jerk", label: "jerk", unit: "mm/s³", ramp: "heat", ...both((i) => path.jerk[i]) });
  modes.push({ id: "cause", label: "limiting cause", kinds: page.causes, ...both((i) => path.cause[i]) });
  modes.push({ id: "age", label: "line age", unit: "line", ramp: "viridis", ...both((i) => path.line[i]) });
  modes.push({ id: "tool", label: "tool", kinds: page.tools.map((t) => "T" + t), ...both((i) => page.tools.indexOf(path.tool[i])) });
  if (path.error) modes.unshift(
    { id: "error", label: page.overlay ? "distance" : "contour error", unit: "um", ramp: "heat", log: true, ...both((i) => path.error[i]) },
    { id: "lag", label: "lag along the path", unit: "ms", ramp: "heat", ...both((i) => path.lag[i]) });
  return modes;
}

// Lowest and highest value of a mode, and how much time the path spends at each (64 bins).
function spreadOf(mode, path, bins = 64) {
  const n = path.feed.length;
  if (mode.kinds) {
    const time = new Float64Array(mode.kinds.length);
    for (let i = 0; i < n; i++) time[mode.at(i)] += path.t[i + 1] - path.t[i];
    return { time };
  }
  let low = Infinity, high = -Infinity;
  for (let i = 0; i < n; i++) {
    if (path.kind[i] !== 0) continue;   // only feeds are coloured
    const a = mode.at(i), b = mode.end(i);
    if (a < low) low = a; if (a > high) high = a; if (b < low) low = b; if (b > high) high = b;
  }
  if (!(low <= high)) { low = 0; high = 1; }
  low = mode.low ?? (mode.log ? Math.max(low, high / 30, 1e-3) : low); high = mode.high ?? high;
  if (!(high > low)) high = low + (Math.abs(low) || 1) * 1e-3;
  const spread = { low, high, log: !!mode.log, time: new Float64Array(bins) };
  for (let i = 0; i < n; i++) {
    const x = shareOf(spread, 0.5 * (mode.at(i) + mode.end(i)));
    if (x === x && path.kind[i] === 0) spread.time[Math.min(bins - 1, Math.floor(x * bins))] += path.t[i + 1] - path.t[i];
  }
  return spread;
}

// 0..1 of a value in a spread; NaN stays NaN.
function shareOf(spread, value) {
  if (value !== value) return NaN;
  const x = spread.log ? Math.log(Math.max(value, spread.low) / spread.low) / Math.log(spread.high / spread.low) : (value - spread.low) / (spread.high - spread.low);
  return x < 0 ? 0 : x > 1 ? 1 : x;
}
function valueAt(spread, share) {
  return spread.log ? spread.low * Math.pow(spread.high / spread.low, share) : spread.low + share * (spread.high - spread.low);
}

// Colours of the stretches index[first..last-1] into out (6 numbers 0..1 a stretch); what the brush leaves out fades.
const KIND_COLOURS = KINDS.map(rgb);
function colourInto(out, mode, spread, brush, index, first, last, faded, none) {
  const map = RAMPS[mode.ramp], kinds = !!mode.kinds;
  for (let k = first; k < last; k++) {
    const i = index[k];
    for (let end = 0; end < 2; end++) {
      const value = end ? mode.end(i) : mode.at(i), o = 6 * k + 3 * end;
      let r, g, b;
      if (kinds) {
        const c = brush.off.has(value) ? faded : KIND_COLOURS[value % KIND_COLOURS.length];
        r = c[0]; g = c[1]; b = c[2];
      } else {
        const x = shareOf(spread, value);
        if (x !== x) { r = none[0]; g = none[1]; b = none[2]; }
        else if (x < brush.low || x > brush.high) { r = faded[0]; g = faded[1]; b = faded[2]; }
        else { const c = 3 * Math.round(255 * x); r = map[c]; g = map[c + 1]; b = map[c + 2]; }
      }
      out[o] = r / 255; out[o + 1] = g / 255; out[o + 2] = b / 255;
    }
  }
}
