"use strict";
/* What is shown, as files: a table of the rows, a picture of the charts. */

function save(name, blob) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob); link.download = name; link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

/* columns: [[head, row index -> number]]; rows [first, last). */
function saveTable(name, columns, [first, last]) {
  const lines = [columns.map(([head]) => head).join(",")];
  for (let i = first; i < last; i++) lines.push(columns.map(([, value]) => { const v = value(i); return Number.isFinite(v) ? String(Number(v.toPrecision(9))) : ""; }).join(","));
  save(name, new Blob([lines.join("\n") + "\n"], { type: "text/csv" }));
}

function savePicture(name, canvases, title) {
  const whole = document.createElement("canvas"), c = whole.getContext("2d"), head = 28 * (window.devicePixelRatio || 1);
  whole.width = Math.max(...canvases.map((one) => one.width)); whole.height = head + canvases.reduce((sum, one) => sum + one.height, 0);
  c.fillStyle = "#fff"; c.fillRect(0, 0, whole.width, whole.height);
  c.fillStyle = "#2b2f36"; c.font = `${head / 2}px system-ui, sans-serif`; c.fillText(title, 12, 0.7 * head);
  let y = head;
  for (const one of canvases) { c.drawImage(one, 0, y); y += one.height; }
  whole.toBlob((blob) => save(name, blob));
}

/* A profile from a file of two columns, seconds and position: the text that the reference is set with. */
function profileOf(text, unit) {
  const rows = text.split(/\r?\n/).map((line) => line.trim().split(/[,;\t ]+/).map(Number)).filter((row) => row.length >= 2 && row.slice(0, 2).every(Number.isFinite));
  return rows.map(([time, value]) => `${time}:${value} ${unit}`).join(", ");
}
