"use strict";
/* What part of the time is shown: the newest seconds, or a stretch that was held still, zoomed and walked along. */

const SPANS = [0.05, 60], USUAL = 12;  // s
const BEFORE_STEP = 0.1, AFTER_STEP = 1.4;  // s around a step of the reference

class TimeWindow {
  constructor(changed) { this.changed = changed; this.span = USUAL; this.held = null; this.cursor = NaN; this.band = null; this.end = 0; }

  /* [from, to] for rows whose newest time is `newest` and whose oldest is `oldest`. */
  range(oldest, newest) {
    if (this.held) return [this.end - this.span, this.end];
    this.end = Math.max(newest, oldest + 1);
    return [Math.max(this.end - this.span, Math.min(oldest, this.end - 1)), this.end];
  }

  hold(rows) { this.held = rows.copy(); this.changed(); }
  release() { this.held = null; this.span = USUAL; this.band = null; this.changed(); }

  zoom(factor, at) {
    const before = this.span;
    this.span = Math.min(Math.max(this.span * factor, SPANS[0]), SPANS[1]);
    if (this.held && Number.isFinite(at)) this.end = at + (this.end - at) * this.span / before;
    this.changed();
  }

  show(from, to) { this.span = Math.min(Math.max(to - from, SPANS[0]), SPANS[1]); this.end = from + this.span; this.changed(); }
  walk(share) { if (this.held) { this.end += share * this.span; this.changed(); } }
}

/* The last moment at which a column stepped, with enough after it to see; NaN without any. */
function lastStep(rows, time, column) {
  const n = rows.length;
  let found = NaN;
  for (let i = n - 1; i > 0 && !(found === found); i--) {
    const a = rows.at(i - 1, column), b = rows.at(i, column);
    if (Number.isFinite(a) && Number.isFinite(b) && a !== b && rows.at(n - 1, time) - rows.at(i, time) > AFTER_STEP / 2) found = rows.at(i, time);
  }
  return found;
}

/* Wheel zooms, a drag selects, a double click goes back to the newest; the pointer is the cursor of all charts. */
function steer(chart, view, rows) {
  const canvas = chart.canvas;
  let begun = NaN;
  canvas.onwheel = (event) => { event.preventDefault(); view.zoom(event.deltaY > 0 ? 1.25 : 0.8, chart.time(event)); };
  canvas.onpointerdown = (event) => { begun = chart.time(event); if (Number.isFinite(begun)) canvas.setPointerCapture(event.pointerId); };
  canvas.onpointermove = (event) => {
    view.cursor = chart.time(event);
    if (Number.isFinite(begun) && Number.isFinite(view.cursor)) { if (!view.held) view.hold(rows()); view.band = [begun, view.cursor]; }
    view.changed();
  };
  canvas.onpointerup = () => {
    const band = view.band; begun = NaN; view.band = null;
    if (band && Math.abs(band[1] - band[0]) > 0.01 * view.span) view.show(Math.min(...band), Math.max(...band));
    view.changed();
  };
  canvas.onpointerleave = () => { view.cursor = NaN; view.changed(); };
  canvas.ondblclick = () => view.release();
}
