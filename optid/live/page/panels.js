"use strict";
/* Everything on the page that is words or tables. */

const MOST = 200;  // events on the page
const by = (id) => document.getElementById(id);
const shown = {};  // what stands in a panel, so that it is made anew only when it changed

function fresh(panel, content) { const text = JSON.stringify(content); if (shown[panel] === text) return false; shown[panel] = text; return true; }
function write(id, text) { if (by(id).textContent !== text) by(id).textContent = text; }
function row(body, cells, kind = "") { const made = body.insertRow(); made.className = kind; for (const cell of cells) made.insertCell().textContent = cell; }

function say(time, words) {
  const line = document.createElement("li"), when = document.createElement("time");
  when.textContent = `${time.toFixed(1)} s`; line.append(when, words);
  by("events").prepend(line);
  while (by("events").childElementCount > MOST) by("events").lastElementChild.remove();
}

function gains(news) {
  if (!fresh("gains", [news.gains, news.review && news.review.new])) return;
  const body = by("gains").tBodies[0]; body.replaceChildren();
  for (const [name, value] of Object.entries(news.gains))
    row(body, [name.replaceAll("_", " "), value.toPrecision(4), news.review ? news.review.new[name].toPrecision(4) : "–"]);
}

function verdict(review, page) {
  if (!review || !fresh("review", [review.new, review.old])) return;
  const lines = [], style = [["old", GREY], ["new", TEAL]];
  for (const [model, pair] of Object.entries(review.responses)) pair.forEach((one, i) => lines.push({
    label: `${style[i][0]}, ${model}`, colour: style[i][1], dash: model === "identified" ? [5, 4] : [],
    value: (k) => one.position[k] === null ? NaN : page.factor * one.position[k] }));
  page.review = new Chart(by("review"), "position", page.unit, lines, [page.factor * review.step]);
  page.reviewLength = review.responses.physical[0].position.length; page.reviewInterval = review.interval;
  by("confirmed").checked = false;
  by("verdict").textContent = review.words.replaceAll("->", "→") + (review.worse.length ? `. Worse: ${review.worse.join("; ")}.` : ".");
}

/* What the parameters are now beside what they were, and what may have changed. */
function followed(news) {
  const found = news.followed;
  if (!found || !fresh("followed", found)) return;
  const body = by("followed").tBodies[0], number = (v, unit) => v === null ? "–" : `${Number(v.toPrecision(4))}${unit === "1" ? "" : ` ${unit}`}`;
  body.replaceChildren();
  for (const one of found.rows)
    row(body, [one.name.replaceAll("_", " ").replace(".", ", "), number(one.then, one.unit), number(one.now, one.unit), `${number(one.low, "1")} to ${number(one.high, "1")}`], one.changed ? "changed" : "");
  write("suspicion", found.words); by("suspicion").classList.toggle("changed", found.rows.some((one) => one.changed));
}

function readout(rows, at, page, fit) {
  const n = rows.length - 1, value = (name) => page.factor * rows.at(n, at[name]);
  const words = (v, unit, digits) => Number.isFinite(v) ? `${v.toFixed(digits)} ${unit}` : "–";
  write("read-reference", words(value("reference"), page.unit, 1)); write("read-measured", words(value("measured"), page.unit, 1));
  write("read-error", words(value("reference") - value("measured"), page.unit, 1));
  write("read-command", words(rows.at(n, at.command), page.input, 2)); write("read-fit", words(fit, "%", 1));
}

/* Ready-made references that fit the stroke. */
function profiles(hello, factor, unit) {
  const [low, high] = hello.limits.stroke, known = low !== null && high !== null, half = known ? factor * (high - low) / 2 : 0;
  const size = (share) => Number((half * share).toPrecision(1)), made = known ? [
    `${size(0.5)} ${unit}`, "tour", `0:0 ${unit}, 2:${size(0.5)} ${unit}, 4:${-size(0.5)} ${unit}, 6:0 ${unit}`,
    `sine ${size(0.4)} ${unit} 0.25 Hz`, `square ${size(0.4)} ${unit} 0.25 Hz`, `triangle ${size(0.4)} ${unit} 0.25 Hz`] : [`1 ${unit}`];
  by("profiles").replaceChildren(...made.map((text) => { const one = document.createElement("option"); one.value = text; return one; }));
  by("wish").placeholder = made[0];
}
