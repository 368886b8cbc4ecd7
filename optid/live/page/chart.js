"use strict";
/* Lines over time on a canvas. Rows live in a ring of fixed size; each pixel column shows its lowest and highest. */

class Rows {
  constructor(columns, size) { this.columns = columns; this.size = size; this.data = new Float64Array(columns * size).fill(NaN); this.count = 0; }
  add(row) { this.data.set(row, (this.count % this.size) * this.columns); this.count += 1; }
  get length() { return Math.min(this.count, this.size); }
  at(i, column) { return this.data[((this.count - this.length + i) % this.size) * this.columns + column]; }
}

const GRID = "#edf0f2", TEXT = "#4a525c", LEFT = 58, RIGHT = 10, TOP = 22, BOTTOM = 20;

class Chart {
  /* lines: [{label, colour, value: row index -> number, dash, width}]; levels: dashed horizontals;
     bounds: no value beyond them widens the axis. */
  constructor(canvas, unit, lines, levels = [], bounds = [-Infinity, Infinity]) {
    this.canvas = canvas; this.unit = unit; this.lines = lines; this.levels = levels; this.bounds = bounds;
  }

  draw(n, x, from, to) {
    const ratio = window.devicePixelRatio || 1, w = this.canvas.clientWidth, h = this.canvas.clientHeight;
    if (this.canvas.width !== Math.round(w * ratio) || this.canvas.height !== Math.round(h * ratio)) {
      this.canvas.width = Math.round(w * ratio); this.canvas.height = Math.round(h * ratio);
    }
    const c = this.canvas.getContext("2d");
    c.setTransform(ratio, 0, 0, ratio, 0, 0); c.clearRect(0, 0, w, h); c.font = "11px system-ui, sans-serif";
    const [low, high] = this.span(n), px = (t) => LEFT + (t - from) / (to - from) * (w - LEFT - RIGHT);
    const py = (v) => TOP + (high - v) / (high - low) * (h - TOP - BOTTOM);
    this.axes(c, w, h, from, to, low, high, px, py);
    c.save(); c.beginPath(); c.rect(LEFT, TOP, w - LEFT - RIGHT, h - TOP - BOTTOM); c.clip();
    for (const line of this.lines) this.line(c, line, n, x, px, py);
    c.restore(); this.legend(c);
  }

  span(n) {
    let low = Infinity, high = -Infinity;
    const [least, most] = this.bounds;
    const see = (v) => { v = Math.min(Math.max(v, least), most); if (v < low) low = v; if (v > high) high = v; };
    for (const line of this.lines) for (let i = 0; i < n; i++) { const v = line.value(i); if (Number.isFinite(v)) see(v); }
    this.levels.forEach(see);
    if (!(low <= high)) return [-1, 1];
    const room = 0.05 * (high - low) || 0.5 * Math.abs(high) || 1;
    return [low - room, high + room];
  }

  axes(c, w, h, from, to, low, high, px, py) {
    c.strokeStyle = GRID; c.fillStyle = TEXT; c.lineWidth = 1; c.textBaseline = "middle"; c.textAlign = "right"; c.setLineDash([]);
    for (const v of ticks(low, high, h / 45)) { stroke(c, LEFT, py(v), w - RIGHT, py(v)); c.fillText(label(v), LEFT - 6, py(v)); }
    c.textAlign = "center"; c.textBaseline = "top";
    for (const t of ticks(from, to, w / 90)) { stroke(c, px(t), TOP, px(t), h - BOTTOM); c.fillText(label(t), px(t), h - BOTTOM + 5); }
    c.strokeStyle = "#9aa3ad"; c.setLineDash([5, 4]);
    for (const v of this.levels) stroke(c, LEFT, py(v), w - RIGHT, py(v));
    c.setLineDash([]);
  }

  line(c, line, n, x, px, py) {
    c.strokeStyle = line.colour; c.lineWidth = line.width || 1.3; c.setLineDash(line.dash || []); c.beginPath();
    let down = false, column = NaN, low = 0, high = 0, last = 0;
    const flush = () => { if (low !== high) { c.lineTo(column, py(low)); c.lineTo(column, py(high)); c.lineTo(column, py(last)); } };
    for (let i = 0; i < n; i++) {
      const v = line.value(i);
      if (!Number.isFinite(v)) { if (down) flush(); down = false; continue; }
      const at = Math.round(px(x(i)));
      if (down && at === column) { low = Math.min(low, v); high = Math.max(high, v); last = v; continue; }
      if (down) { flush(); c.lineTo(at, py(v)); } else c.moveTo(at, py(v));
      down = true; column = at; low = high = last = v;
    }
    if (down) flush();
    c.stroke(); c.setLineDash([]);
  }

  legend(c) {
    let at = LEFT;
    c.textAlign = "left"; c.textBaseline = "middle";
    c.fillStyle = TEXT; c.fillText(this.unit, 6, 9);
    for (const line of this.lines) {
      if (!line.label) continue;
      c.strokeStyle = line.colour; c.lineWidth = 2; c.setLineDash(line.dash || []); stroke(c, at, 9, at + 16, 9); c.setLineDash([]);
      c.fillText(line.label, at + 21, 9); at += 35 + c.measureText(line.label).width;
    }
  }
}

function stroke(c, x1, y1, x2, y2) { c.beginPath(); c.moveTo(x1, y1); c.lineTo(x2, y2); c.stroke(); }
function label(v) { return String(Number(v.toPrecision(6))); }
function ticks(low, high, wanted) {
  const rough = (high - low) / Math.max(wanted, 1), power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((k) => k * power).find((s) => s >= rough), found = [];
  for (let k = Math.ceil(low / step); k * step <= high; k++) found.push(k * step);
  return found;
}
