// Blocks of the page: base64 -> gzip -> bytes sorted by weight -> differences -> numbers. The browser decompresses
// outside the main thread; what is left to do here is done an array at a time, with a breath in between.
const $ = (id) => document.getElementById(id);
const breath = () => new Promise((done) => { const c = new MessageChannel(); c.port1.onmessage = done; c.port2.postMessage(0); });

async function unpacked(id) {
  const element = $(id);
  if (!element) return null;
  const source = await fetch("data:application/octet-stream;base64," + element.textContent).catch((e) => { throw new Error(id + ": " + e.message); });
  element.remove();
  return new Response(source.body.pipeThrough(new DecompressionStream("gzip")));
}

async function textOf(id) { const r = await unpacked(id); return r ? new Uint8Array(await r.arrayBuffer()) : null; }

function jsonOf(id) { const e = $(id); return e ? JSON.parse(e.textContent) : null; }

// One array: four planes of n bytes from offset on, folded differences, times its unit.
function decoded(bytes, offset, n, unit) {
  const out = new Float64Array(n), n2 = 2 * n, n3 = 3 * n;
  let value = 0;
  for (let i = 0, k = offset; i < n; i++, k++) {
    const folded = bytes[k] + bytes[k + n] * 256 + bytes[k + n2] * 65536 + bytes[k + n3] * 16777216;
    value += folded % 2 ? -(folded + 1) / 2 : folded / 2;
    out[i] = value * unit;
  }
  return out;
}

// All arrays of a block by name; numbered ones ("q0", "q1") also as a list under the bare name.
async function blockOf(id) {
  const manifest = jsonOf(id + "-manifest"), response = await unpacked(id);
  if (!response) return null;
  const bytes = new Uint8Array(await response.arrayBuffer()), out = {};
  let offset = 0;
  for (const { name, length, unit } of manifest) {
    out[name] = decoded(bytes, offset, length, unit);
    offset += 4 * length;
    const [, base, digit] = /^(.*?)(\d+)$/.exec(name) || [];
    if (base) (out[base] ||= [])[+digit] = out[name];
    if (length > 20000) await breath();
  }
  return out;
}

// Index of the last element <= x of an ascending array (-1: none).
function lastAtOrBefore(array, x) {
  let low = 0, high = array.length;
  while (low < high) { const middle = (low + high) >> 1; if (array[middle] <= x) low = middle + 1; else high = middle; }
  return low - 1;
}

function clockText(s) {
  const sign = s < 0 ? "-" : "", whole = Math.abs(s), h = Math.floor(whole / 3600), m = Math.floor(whole / 60) % 60, r = whole % 60;
  const sec = r.toFixed(whole < 600 ? 3 : 1).padStart(whole < 600 ? 6 : 4, "0");
  return sign + (h ? h + ":" + String(m).padStart(2, "0") : m) + ":" + sec;
}
function short(x) {
  if (!isFinite(x)) return "–";
  const a = Math.abs(x);
  return a === 0 ? "0" : a >= 1e5 ? x.toExponential(1) : a >= 100 ? x.toFixed(0) : a >= 10 ? x.toFixed(1) : a >= .1 ? x.toFixed(2) : a >= .001 ? x.toFixed(4) : x.toExponential(1);
}
function make(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [key, value] of Object.entries(attributes)) {
    if (key.startsWith("on")) element.addEventListener(key.slice(2), value);
    else if (key === "class") element.className = value;
    else if (key === "style") element.style.cssText = value;
    else if (value !== false && value != null) element.setAttribute(key, value === true ? "" : value);
  }
  element.append(...children.filter((c) => c != null));
  return element;
}
const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
