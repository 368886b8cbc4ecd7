"use strict";
/* Lines over time on a canvas. Rows live in a ring of fixed size; each pixel column shows its lowest and highest. */

class Rows {
  constructor(columns, size) { this.columns = columns; this.size = size; this.data = new Float64Array(columns * size).fill(NaN); this.count = 0; }
  add(row) { this.data.set(row, (this.count % this.size) * this.columns); this.count += 1; }
  get length() { return Math.min(this.count, this.size); }
  at(i, column) { return this.data[((this.count - this.length + i) % this.size) * this.columns + column]; }
  copy() { const other = new Rows(this.columns, this.size); other.data.set(this.data); other.count = this.count; return other; }
  /* First row whose value in a column that increases is not below `v`. */
  find(column, v) { let a = 0, b = this.length; while (a < b) { const m = (a + b) >> 1; if (this.at(m, column) < v) a = m + 1; else b = m; } return a; }
}

const GRID = "#e3e7ea", TEXT = "#3c434c";
const CALM = 5;       // s for which lines must fill less than half of an axis before it shrinks
const SLIM = 0.5;

/* An axis that grows at once, in round steps, and shrinks only after a while, so that a line's height means something. */
class Scale {
  constructor() { this.low = NaN; this.high = NaN; this.slim = NaN; }

  fit(low, high, now, tight) {
    if (!(low <= high)) { low = -1; high = 1; }
    const room = 0.05 * (high - low) || 0.5 * Math.abs(high) || 1, [least, most] = rounded(low - room, high + room);
    if (tight) return [least, most];
    if (!(this.low <= low && this.high >= high)) {
      const grown = this.low <= this.high ? rounded(Math.min(least, this.low), Math.max(most, this.high)) : [least, most];
      [this.low, this.high] = grown; this.slim = NaN;
    } else if (most - least < SLIM * (this.high - this.low)) {
      if (!(now >= this.slim)) this.slim = now;
      if (now - this.slim > CALM) { this.low = least; this.high = most; this.slim = NaN; }
    } else this.slim = NaN;
    return [this.low, this.high];
  }
}

class Chart {
  /* name, unit: of the axis. lines: [{label, colour, value: row index -> number, dash, width}]; levels: dashed horizontals;
     bounds: no value beyond them widens the axis. */
  constructor(canvas, name, unit, lines, levels = [], bounds = [-Infinity, Infinity]) {
    this.canvas = canvas; this.name = name; this.unit = unit; this.lines = lines; this.levels = levels; this.bounds = bounds;
    this.scale = new Scale();
  }

  /* rows [first, last) at times x(i), from `from` to `to`; cursor: a time; tight: the axis fits what is shown. */
  draw([first, last], x, [from, to], { cursor = NaN, tight = false, at = -1, band = null } = {}) {
    const c = this.ready(), w = this.canvas.clientWidth, h = this.canvas.clientHeight, size = this.size;
    this.left = 5.2 * size; this.right = size; this.top = 2.1 * size; this.bottom = 1.9 * size;
    const [low, high] = this.span(first, last, to, tight);
    const px = (t) => this.left + (t - from) / (to - from) * (w - this.left - this.right);
    const py = (v) => this.top + (high - v) / (high - low) * (h - this.top - this.bottom);
    this.from = from; this.to = to;
    this.axes(c, w, h, from, to, low, high, px, py);
    c.save(); c.beginPath(); c.rect(this.left, this.top, w - this.left - this.right, h - this.top - this.bottom); c.clip();
    if (band) { c.fillStyle = "#0a7e8c22"; c.fillRect(px(band[0]), 0, px(band[1]) - px(band[0]), h); }
    for (const line of this.lines) this.line(c, line, first, last, x, px, py);
    if (Number.isFinite(cursor)) { c.strokeStyle = TEXT; c.lineWidth = 1; stroke(c, px(cursor), this.top, px(cursor), h - this.bottom); }
    c.restore(); this.legend(c, at);
  }

  ready() {
    const ratio = window.devicePixelRatio || 1, w = this.canvas.clientWidth, h = this.canvas.clientHeight;
    if (this.canvas.width !== Math.round(w * ratio) || this.canvas.height !== Math.round(h * ratio)) {
      this.canvas.width = Math.round(w * ratio); this.canvas.height = Math.round(h * ratio);
    }
    this.size = parseFloat(getComputedStyle(this.canvas).fontSize) || 12;
    const c = this.canvas.getContext("2d");
    c.setTransform(ratio, 0, 0, ratio, 0, 0); c.clearRect(0, 0, w, h); c.font = `${this.size}px system-ui, sans-serif`;
    return c;
  }

  /* The time at a place on the page; NaN beside the axes. */
  time(event) {
    const box = this.canvas.getBoundingClientRect(), share = (event.clientX - box.left - this.left) / (box.width - this.left - this.right);
    return share >= 0 && share <= 1 ? this.from + share * (this.to - this.from) : NaN;
  }

  span(first, last, now, tight) {
    let low = Infinity, high = -Infinity;
    const [least, most] = this.bounds;
    const see = (v) => { v = Math.min(Math.max(v, least), most); if (v < low) low = v; if (v > high) high = v; };
    for (const line of this.lines) for (let i = first; i < last; i++) { const v = line.value(i); if (Number.isFinite(v)) see(v); }
    this.levels.forEach(see);
    return this.scale.fit(low, high, now, tight);
  }

  axes(c, w, h, from, to, low, high, px, py) {
    const size = this.size;
    c.strokeStyle = GRID; c.fillStyle = TEXT; c.lineWidth = 1; c.textBaseline = "middle"; c.textAlign = "right"; c.setLineDash([]);
    for (const v of ticks(low, high, h / (2.6 * size))) { stroke(c, this.left, py(v), w - this.right, py(v)); c.fillText(label(v), this.left - size / 2, py(v)); }
    c.textAlign = "center"; c.textBaseline = "top";
    for (const t of ticks(from, to, w / (7.5 * size))) {
      stroke(c, px(t), this.top, px(t), h - this.bottom);
      if (px(t) < w - this.right - 2.5 * size) c.fillText(label(t), px(t), h - this.bottom + size / 2);
    }
    c.textAlign = "right"; c.fillText("s", w - this.right, h - this.bottom + size / 2);
    c.strokeStyle = "#9aa3ad"; c.setLineDash([5, 4]);
    for (const v of this.levels) stroke(c, this.left, py(v), w - this.right, py(v));
    c.setLineDash([]);
  }

  line(c, line, first, last, x, px, py) {
    c.strokeStyle = line.colour; c.lineWidth = (line.width || 1.3) * Math.max(1, this.size / 12); c.setLineDash(line.dash || []); c.beginPath();
    let down = false, column = NaN, low = 0, high = 0, end = 0;
    const flush = () => { if (low !== high) { c.lineTo(column, py(low)); c.lineTo(column, py(high)); c.lineTo(column, py(end)); } };
    for (let i = first; i < last; i++) {
      const v = line.value(i);
      if (!Number.isFinite(v)) { if (down) flush(); down = false; continue; }
      const at = Math.round(px(x(i)));
      if (down && at === column) { low = Math.min(low, v); high = Math.max(high, v); end = v; continue; }
      if (down) { flush(); c.lineTo(at, py(v)); } else c.moveTo(at, py(v));
      down = true; column = at; low = high = end = v;
    }
    if (down) flush();
    c.stroke(); c.setLineDash([]);
  }

  /* Names of the lines, with their values at row `at` where that is not negative. */
  legend(c, at) {
    const size = this.size, y = 0.9 * size;
    let x = 0.5 * size;
    c.textAlign = "left"; c.textBaseline = "middle"; c.fillStyle = TEXT;
    const head = this.unit ? `${this.name}, ${this.unit}` : this.name;
    c.fillText(head, x, y); x += c.measureText(head).width + 1.5 * size;
    for (const line of this.lines) {
      if (!line.label) continue;
      const v = at >= 0 ? line.value(at) : NaN, words = Number.isFinite(v) ? `${line.label} ${v.toPrecision(5)}` : line.label;
      c.strokeStyle = line.colour; c.lineWidth = size / 5; c.setLineDash(line.dash || []); stroke(c, x, y, x + 1.5 * size, y); c.setLineDash([]);
      c.fillText(words, x + 1.9 * size, y); x += 3.2 * size + c.measureText(words).width;
    }
  }
}

function stroke(c, x1, y1, x2, y2) { c.beginPath(); c.moveTo(x1, y1); c.lineTo(x2, y2); c.stroke(); }
function label(v) { return String(Number(v.toPrecision(6))); }
function stepped(range, wanted) {
  const rough = range / Math.max(wanted, 1), power = 10 ** Math.floor(Math.log10(rough));
  return [1, 2, 5, 10].map((k) => k * power).find((s) => s >= rough * (1 - 1e-9));
}
function rounded(low, high) { const step = stepped(high - low, 8); return [Math.floor(low / step) * step, Math.ceil(high / step) * step]; }
function ticks(low, high, wanted) {
  const step = stepped(high - low, wanted), found = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) found.push(k * step);
  return found;
}
