"use strict";
/* What the server says goes into rings and onto the page; buttons and keys go back as orders. */

const SHOWN = 12, INK = "#2b2f36", TEAL = "#0a7e8c", ORANGE = "#c8743a", GREY = "#9aa3ad", RED = "#b3372f";
const MOST = 200;  // events on the page
const TRIES = 10;  // to reach a session that does not answer, a second apart
const by = (id) => document.getElementById(id);
const page = { signals: null, slow: null, charts: [], news: null, socket: null, ended: false, stale: true, tries: 0 };

function begin(hello) {
  page.tries = 0; by("events").replaceChildren();
  const rate = Math.min(hello.rate, 250), at = Object.fromEntries(hello.signals.map((name, i) => [name, i]));
  page.signals = new Rows(hello.signals.length, Math.ceil(1.2 * SHOWN * rate));
  page.slow = new Rows(hello.slow.length, Math.ceil(20 * hello.keep));
  const metres = hello.output.unit === "m", factor = metres ? 1e3 : 1, unit = metres ? "mm" : hello.output.unit;
  const s = page.signals, value = (name) => (i) => factor * s.at(i, at[name]);
  const coefficients = hello.slow.slice(4), colour = { a: TEAL, b: ORANGE, c: GREY };
  by("rig").textContent = hello.rig; by("driver").textContent = `${hello.driver}, ${hello.rate} Hz`;
  page.time = (i) => s.at(i, at.time);
  page.charts = [
    new Chart(by("position"), unit, [
      { label: "reference", colour: GREY, value: value("reference"), dash: [6, 4] },
      { label: "real", colour: INK, value: value("measured"), width: 2 },
      { label: "predicted", colour: TEAL, value: value("predicted") },
      { label: "simulated", colour: ORANGE, value: value("simulated") }]),
    new Chart(by("command"), hello.input.unit, [{ label: hello.input.name, colour: INK, value: (i) => s.at(i, at.command) }],
      [hello.limits.low, hello.limits.high]),
    new Chart(by("mismatch"), unit, [
      { label: "real minus 0.5 s windows of the physical model", colour: ORANGE, value: (i) => factor * (s.at(i, at.measured) - s.at(i, at.windowed)) }]),
    new Chart(by("residual"), unit, [{ label: "real minus predicted", colour: TEAL, value: value("innovation") }])];
  const seen = new Set();
  page.theta = new Chart(by("theta"), "", coefficients.map((name, i) => {
    const family = name[0], label = seen.has(family) ? "" : { a: "a", b: `b / largest b`, c: "c" }[family];
    seen.add(family);
    return { label, colour: colour[family], value: (k) => family === "b" ? page.slow.at(k, 4 + i) / page.largest : page.slow.at(k, 4 + i) };
  }), [], [-2.5, 2.5]);
  page.bs = coefficients.map((name, i) => name[0] === "b" ? 4 + i : -1).filter((i) => i >= 0);
  page.unit = unit; page.factor = factor;
}

function heed(news) {
  page.news = news;
  for (const row of news.slow) page.slow.add(row.map((x) => x === null ? NaN : x));
  for (const [time, words] of news.events) say(time, words);
  by("tune").disabled = news.tuning || page.ended;
  by("stop").disabled = page.ended;
  const parted = news.parted ? `Rig and model have parted. What is missing finds: ${news.diagnosis}` : "";
  by("parted").hidden = !parted;
  if (by("parted").textContent !== parted) by("parted").textContent = parted;
  table(news); verdict(news.review); allow();
  if (news.end) { page.ended = true; over(`${news.end.how}: ${news.end.why}`); }
}

function allow() {  // worse gains want a tick first
  const news = page.news, worse = Boolean(news.review && news.review.worse.length);
  by("doubt").hidden = !(worse && news.applicable);
  by("apply").disabled = !news.applicable || page.ended || (worse && !by("confirmed").checked);
}

function say(time, words) {
  const line = document.createElement("li"), when = document.createElement("time");
  when.textContent = `${time.toFixed(1)} s`; line.append(when, words);
  by("events").prepend(line);
  while (by("events").childElementCount > MOST) by("events").lastElementChild.remove();
}

function table(news) {
  const text = JSON.stringify([news.gains, news.review && news.review.new]);
  if (text === page.gains) return;
  page.gains = text;
  by("gains").tBodies[0].replaceChildren(...Object.entries(news.gains).map(([name, value]) => {
    const row = document.createElement("tr"), next = news.review ? news.review.new[name].toPrecision(4) : "–";
    for (const cell of [name.replaceAll("_", " "), value.toPrecision(4), next]) row.insertCell().textContent = cell;
    return row;
  }));
}

function verdict(review) {
  const text = JSON.stringify(review && [review.new, review.old]);
  if (!review || text === page.reviewed) return;
  page.reviewed = text;
  const lines = [], style = [["old", GREY], ["new", TEAL]];
  for (const [model, pair] of Object.entries(review.responses)) pair.forEach((one, i) => lines.push({
    label: `${style[i][0]}, ${model}`, colour: style[i][1], dash: model === "identified" ? [5, 4] : [],
    value: (k) => one.position[k] === null ? NaN : page.factor * one.position[k] }));
  page.review = new Chart(by("review"), page.unit, lines, [page.factor * review.step]);
  page.reviewLength = review.responses.physical[0].position.length; page.reviewInterval = review.interval;
  by("confirmed").checked = false;
  by("verdict").textContent = review.words.replaceAll("->", "→") + (review.worse.length ? `. Worse: ${review.worse.join("; ")}.` : ".");
}

function over(words) {
  by("state").textContent = words;
  by("confirmed").addEventListener("change", allow);
for (const id of ["tune", "apply", "stop"]) by(id).disabled = true;
}

function draw() {
  const s = page.signals;
  if (s && s.length && page.stale) {
    page.stale = false;
    const to = page.time(s.length - 1), from = Math.max(to - SHOWN, page.time(0));
    for (const chart of page.charts) chart.draw(s.length, page.time, from, Math.max(to, from + 1));
    const m = page.slow.length;
    if (m) {
      page.largest = Math.max(1e-300, ...page.bs.map((i) => Math.abs(page.slow.at(m - 1, i))));
      const start = page.slow.at(0, 0), end = page.slow.at(m - 1, 0);
      page.theta.draw(m, (i) => page.slow.at(i, 0), start, Math.max(end, start + 1));
    }
    if (page.review) page.review.draw(page.reviewLength, (i) => i * page.reviewInterval, 0, page.reviewLength * page.reviewInterval);
    if (!page.ended && m) {
      const fit = page.slow.at(m - 1, 1);
      by("state").textContent = `${to.toFixed(1)} s` + (Number.isFinite(fit) ? `, physical model fits ${fit.toFixed(1)} %` : "");
    }
  }
  requestAnimationFrame(draw);
}

function receive(event) {
  if (typeof event.data === "string") {
    const message = JSON.parse(event.data);
    if (message.kind === "hello") begin(message); else heed(message);
  } else {
    const all = new Float64Array(event.data), wide = page.signals.columns;
    for (let i = 0; i + wide <= all.length; i += wide) page.signals.add(all.subarray(i, i + wide));
  }
  page.stale = true;
}

function order(wish) { if (page.socket.readyState === WebSocket.OPEN && !by(wish).disabled) page.socket.send(JSON.stringify({ do: wish, confirmed: wish === "apply" && by("confirmed").checked })); }

function connect() {
  page.socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/live`);
  page.socket.binaryType = "arraybuffer"; page.socket.onmessage = receive;
  page.socket.onclose = () => {
    if (page.ended) return;
    page.tries += 1; over(page.tries < TRIES ? "no answer; trying again" : "the session no longer answers");
    if (page.tries < TRIES) setTimeout(connect, 1000);
  };
}

for (const id of ["tune", "apply", "stop"]) by(id).addEventListener("click", () => order(id));
document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || event.repeat) return;
  const wish = { t: "tune", a: "apply", Escape: "stop" }[event.key.length === 1 ? event.key.toLowerCase() : event.key];
  if (wish) { event.preventDefault(); if (wish === "apply") by(wish).focus(); else order(wish); }
});
connect(); requestAnimationFrame(draw);
