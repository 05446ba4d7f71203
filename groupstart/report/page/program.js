// The program text: only the rows that are seen exist. Lines are found in the bytes once, in pieces.
const ROW = 18, TALLEST = 8e6;

class Program {
  constructor(onLine) {
    this.onLine = onLine; this.scroll = $("program-scroll"); this.rows = $("program-rows"); this.space = $("program-space");
    this.now = 0; this.decoder = new TextDecoder();
    this.scroll.addEventListener("scroll", () => this.ask());
    new ResizeObserver(() => this.ask()).observe(this.scroll);
    this.rows.addEventListener("click", (e) => { const row = e.target.closest(".row"); if (row) this.onLine(+row.dataset.line); });
  }

  async load(bytes) {
    this.bytes = bytes;
    let starts = new Uint32Array(1024), n = 1;
    for (let i = 0; i < bytes.length; i++) {
      const b = bytes[i];
      if (b === 10 || (b === 13 && bytes[i + 1] !== 10)) {
        if (n === starts.length) { const more = new Uint32Array(2 * n); more.set(starts); starts = more; }
        starts[n++] = i + 1;
      }
      if ((i & 0x3fffff) === 0x3fffff) await breath();
    }
    if (n > 1 && starts[n - 1] >= bytes.length) n--;
    this.starts = starts.subarray(0, n); this.count = n;
    this.height = Math.min(n * ROW, TALLEST);
    this.space.style.height = this.height + "px";
    this.paint();
  }

  line(number) {
    const a = this.starts[number - 1], b = number < this.count ? this.starts[number] : this.bytes.length;
    return this.decoder.decode(this.bytes.subarray(a, Math.min(b, a + 400))).replace(/[\r\n]+$/, "");
  }

  // On long programs the scroll bar is shorter than the rows: its share of the way is the share of the program.
  firstRow() {
    const seen = this.scroll.clientHeight, way = this.height - seen;
    if (this.height === this.count * ROW || way <= 0) return this.scroll.scrollTop / ROW;
    return (this.scroll.scrollTop / way) * Math.max(this.count - seen / ROW, 0);
  }
  ask() { if (!this.asked) { this.asked = true; requestAnimationFrame(() => { this.asked = false; this.paint(); }); } }

  paint() {
    if (!this.starts) return;
    const first = this.firstRow(), from = Math.max(Math.floor(first), 0), seen = Math.ceil(this.scroll.clientHeight / ROW) + 1, rows = [];
    for (let r = from; r < Math.min(from + seen, this.count); r++) rows.push(this.row(r + 1));
    this.rows.style.transform = `translateY(${-(first - from) * ROW}px)`;
    this.rows.replaceChildren(...rows);
  }

  row(number) {
    const words = make("span"), row = make("div", { class: "row" + (number === this.now ? " now" : ""), "data-line": number }, make("i", {}, String(number)), words);
    for (const part of this.line(number).split(/(\([^)]*\)?|;.*|[GMTO]\s*[\d.]+|F\s*[\d.]+)/i)) {
      if (!part) continue;
      const kind = /^[(;]/.test(part) ? "c" : /^[GMTO]\s*\d/i.test(part) ? "w" : /^F\s*[\d.]/i.test(part) ? "f" : "";
      words.append(kind ? make("span", { class: kind }, part) : part);
    }
    return row;
  }

  select(number) {
    if (number === this.now || !this.starts) return;
    this.now = number;
    $("line-now").textContent = number ? `line ${number}` : "";
    const first = this.firstRow(), seen = this.scroll.clientHeight / ROW, at = number - 1;
    if (number && (at < first + 1 || at > first + seen - 3)) {
      const top = Math.max(at - seen * .4, 0), way = this.height - this.scroll.clientHeight;
      this.scroll.scrollTop = this.height === this.count * ROW ? top * ROW : way * Math.min(top / Math.max(this.count - seen, 1), 1);
    }
    this.ask();
  }
}
