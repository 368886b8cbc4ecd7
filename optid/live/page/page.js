"use strict";
/* What the server says goes into rings and onto the page; buttons and keys go back as orders. */

const INK = "#2b2f36", TEAL = "#0a7e8c", ORANGE = "#c8743a", GREY = "#8a939c";
const TRIES = 10;  // to reach a session that does not answer, a second apart
const KEPT = 60;  // s of signals
const TOKEN = "token=", PROTOCOL = "optid.live";
const ORDERS = ["tune", "apply", "stop"];
const page = { signals: null, slow: null, charts: [], news: null, socket: null, ended: false, stale: true, tries: 0, heard: false };
const view = new TimeWindow(() => { page.stale = true; });

function begin(hello) {
  page.tries = 0; page.heard = true; by("events").replaceChildren(); by("state").textContent = "";
  for (const panel of Object.keys(shown)) delete shown[panel];
  const rate = Math.min(hello.rate, 250), at = Object.fromEntries(hello.signals.map((name, i) => [name, i]));
  page.signals = new Rows(hello.signals.length, Math.ceil(1.2 * KEPT * rate));
  page.slow = new Rows(hello.slow.length, Math.ceil(20 * hello.keep));
  const metres = hello.output.unit === "m";
  page.factor = metres ? 1e3 : 1; page.unit = metres ? "mm" : hello.output.unit; page.input = hello.input.unit; page.at = at;
  const value = (name) => (i) => page.factor * page.rows().at(i, at[name]);
  by("rig").textContent = hello.rig; by("driver").textContent = `${hello.driver}, ${hello.rate} Hz`;
  page.rows = () => view.held || page.signals;
  page.time = (i) => page.rows().at(i, at.time);
  page.charts = [
    new Chart(by("position"), hello.output.name, page.unit, [
      { label: "reference", colour: GREY, value: value("reference"), dash: [6, 4], width: 1.6 },
      { label: "real", colour: INK, value: value("measured"), width: 4 },
      { label: "predicted", colour: TEAL, value: value("predicted"), width: 1.4 },
      { label: "simulated", colour: ORANGE, value: value("simulated"), width: 1.6 }]),
    new Chart(by("command"), hello.input.name, page.input, [{ label: "applied", colour: INK, value: (i) => page.rows().at(i, at.command) }],
      [hello.limits.low, hello.limits.high]),
    new Chart(by("mismatch"), "mismatch", page.unit, [
      { label: "real minus 0.5 s windows", colour: ORANGE, value: (i) => page.factor * (page.rows().at(i, at.measured) - page.rows().at(i, at.windowed)) }]),
    new Chart(by("residual"), "residual", page.unit, [{ label: "real minus predicted", colour: TEAL, value: value("innovation") }])];
  page.theta = new Chart(by("theta"), "coefficient", "", coefficients(hello.slow.slice(4)), [], [-2.5, 2.5]);
  for (const chart of page.charts) steer(chart, view, page.rows);
  by("hides").hidden = !hello.hides; by("hides").textContent = `The rig is simulated. It differs from the rig file in: ${hello.hides}.`;
  by("log").textContent = `Every sample is in ${hello.log}.`;
  page.controls = hello.controls; profiles(hello, page.factor, page.unit); orders();
}

function coefficients(names) {
  const seen = new Set(), colour = { a: TEAL, b: ORANGE, c: GREY };
  page.bs = names.map((name, i) => name[0] === "b" ? 4 + i : -1).filter((i) => i >= 0);
  return names.map((name, i) => {
    const family = name[0], label = seen.has(family) ? "" : { a: "a", b: "b / largest b", c: "c" }[family];
    seen.add(family);
    return { label, colour: colour[family], value: (k) => family === "b" ? page.slow.at(k, 4 + i) / page.largest : page.slow.at(k, 4 + i) };
  });
}

function heed(news) {
  page.news = news;
  for (const one of news.slow) page.slow.add(one.map((x) => x === null ? NaN : x));
  for (const [time, words] of news.events) say(time, words);
  by("disagree").hidden = !news.disagree; write("diagnosis", news.diagnosis);
  gains(news); verdict(news.review, page); followed(news);
  if (news.end) { page.ended = true; by("state").textContent = `${news.end.how}: ${news.end.why}`; }
  orders();
}

/* Which buttons can be used now; worse gains want a tick first. */
function orders(lost = false) {
  const news = page.news, off = page.ended || lost || !page.heard, worse = Boolean(news && news.review && news.review.worse.length);
  by("doubt").hidden = !(news && worse && news.applicable);
  by("tune").disabled = off || !news || news.tuning; by("stop").disabled = off;
  by("apply").disabled = off || !news || !news.applicable || (worse && !by("confirmed").checked);
  for (const id of ["wish", "set", "profile"]) by(id).disabled = off || !page.controls;
}

function draw() {
  const rows = page.signals && page.rows();
  if (rows && rows.length && page.stale) {
    page.stale = false;
    const range = view.range(rows.at(0, page.at.time), rows.at(rows.length - 1, page.at.time));
    const find = (t) => rows.find(page.at.time, t), within = [Math.max(find(range[0]) - 1, 0), Math.min(find(range[1]) + 1, rows.length)];
    const at = Number.isFinite(view.cursor) ? Math.min(find(view.cursor), rows.length - 1) : -1;
    const how = { cursor: view.cursor, at, tight: Boolean(view.held), band: view.band };
    for (const chart of page.charts) chart.draw(within, page.time, range, how);
    page.within = within; slow();
    if (page.review) page.review.draw([0, page.reviewLength], (i) => i * page.reviewInterval, [0, page.reviewLength * page.reviewInterval], { tight: true });
  }
  requestAnimationFrame(draw);
}

function slow() {
  const m = page.slow.length, fit = m ? page.slow.at(m - 1, 1) : NaN, s = page.signals, newest = s.at(s.length - 1, page.at.time);
  readout(s, page.at, page, fit);
  if (!page.ended) by("state").textContent = `${newest.toFixed(1)} s` + (view.held ? `, charts held at ${view.end.toFixed(1)} s` : "");
  by("pause").setAttribute("aria-pressed", String(Boolean(view.held)));
  if (!m) return;
  page.largest = Math.max(1e-300, ...page.bs.map((i) => Math.abs(page.slow.at(m - 1, i))));
  const start = page.slow.at(0, 0), end = page.slow.at(m - 1, 0);
  page.theta.draw([0, m], (i) => page.slow.at(i, 0), [start, Math.max(end, start + 1)]);
}

function receive(event) {
  if (typeof event.data === "string") {
    const message = JSON.parse(event.data);
    if (message.kind === "hello") begin(message); else if (message.kind === "answer") write("answer", message.words); else heed(message);
  } else {
    const all = new Float64Array(event.data), wide = page.signals.columns;
    for (let i = 0; i + wide <= all.length; i += wide) page.signals.add(all.subarray(i, i + wide));
  }
  page.stale = true;
}

function send(message) { if (page.socket.readyState === WebSocket.OPEN) page.socket.send(JSON.stringify(message)); }
function order(wish) { if (!by(wish).disabled) send({ do: wish, confirmed: wish === "apply" && by("confirmed").checked }); }
function demand(text) {
  const bare = /^[-+]?[\d.]+$/.test(text.trim());
  write("answer", ""); send({ do: "reference", text: bare ? `${text.trim()} ${page.unit}` : text });
}

const views = {
  pause: () => view.held ? view.release() : view.hold(page.signals), closer: () => view.zoom(0.8, view.cursor), wider: () => view.zoom(1.25, view.cursor), newest: () => view.release(),
  step: () => { const t = lastStep(page.rows(), page.at.time, page.at.reference); if (t === t) { if (!view.held) view.hold(page.signals); view.show(t - BEFORE_STEP, t + AFTER_STEP); } },
  table: () => saveTable("optid-live.csv", [["time_s", page.time], ...page.charts.flatMap((chart) => chart.lines.map((line) => [`${line.label.replaceAll(" ", "_")}_${chart.unit}`, line.value]))], page.within),
  picture: () => savePicture("optid-live.png", page.charts.slice(0, 2).map((chart) => chart.canvas), `${by("rig").textContent}, ${by("driver").textContent}`),
  wall: () => { by("wall").setAttribute("aria-pressed", String(document.body.classList.toggle("wall"))); page.stale = true; },
};

/* The token comes in the address once, and stays with this tab. */
function token() {
  const given = location.hash.slice(1);
  if (given.startsWith(TOKEN)) { sessionStorage.setItem("token", decodeURIComponent(given.slice(TOKEN.length))); history.replaceState(null, "", location.pathname); }
  const bytes = new TextEncoder().encode(sessionStorage.getItem("token") || "");
  return Array.from(bytes, (byte) => byte.toString(16).padStart(2, "0")).join("");
}

function connect() {
  const secret = token();
  page.socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/live`, secret ? [PROTOCOL, secret] : [PROTOCOL]);
  page.socket.binaryType = "arraybuffer"; page.socket.onmessage = receive;
  page.socket.onclose = () => {
    if (page.ended) return;
    orders(true);
    if (!page.heard) { by("state").textContent = "access refused: the token is missing or wrong, or too many pages are open. Open the address that the terminal printed."; return; }
    page.tries += 1; by("state").textContent = page.tries < TRIES ? "no connection; trying again" : "the session does not respond any more";
    if (page.tries < TRIES) setTimeout(connect, 1000);
  };
}

for (const id of ORDERS) by(id).addEventListener("click", () => order(id));
for (const [id, act] of Object.entries(views)) by(id).addEventListener("click", () => { if (page.signals && page.signals.length) act(); });
by("confirmed").addEventListener("change", () => orders());
by("demand").addEventListener("submit", (event) => { event.preventDefault(); demand(by("wish").value); });
by("profile").addEventListener("change", async (event) => {
  const file = event.target.files[0];
  if (file) { by("wish").value = profileOf(await file.text(), page.unit); demand(by("wish").value); }
});
document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || event.repeat) return;
  const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
  if (event.target.tagName === "INPUT" && event.target.type !== "checkbox" && key !== "Escape") return;
  const wish = { t: "tune", a: "apply", Escape: "stop" }[key], look = { p: "pause", "+": "closer", "-": "wider", s: "step", 0: "newest", w: "wall" }[key];
  if (wish) { event.preventDefault(); if (wish === "apply") by(wish).focus(); else order(wish); }
  else if (look) by(look).click();
  else if (key === "ArrowLeft" || key === "ArrowRight") view.walk(key === "ArrowLeft" ? -0.2 : 0.2);
});
connect(); requestAnimationFrame(draw);
