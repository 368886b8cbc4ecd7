"use strict";
// Unpacks the plotting library and the page's figures, draws them, and follows a dark screen and the printer.
(() => {
  const DARK = matchMedia("(prefers-color-scheme: dark)");
  // Ink and greys of optid/report/figures.py that would not be seen on a dark page.
  const ON_DARK = { "43,47,54": "226,230,234", "154,163,173": "132,141,151", "10,126,140": "64,190,205",
    "200,116,58": "232,150,92", "179,55,47": "236,112,103" };

  async function unpacked(element) {
    const bytes = Uint8Array.from(atob(element.textContent), (letter) => letter.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
    return new Response(stream).text();
  }

  function shaded(text, dark) {
    return dark ? text.replace(/rgba\((\d+,\d+,\d+)/g, (all, rgb) => `rgba(${ON_DARK[rgb] ?? rgb}`) : text;
  }

  function dressed(text, dark) {
    const figure = JSON.parse(shaded(text, dark));
    const [ink, grid, line] = dark ? ["#c3c9d0", "#2c323a", "#4a525c"] : ["#4a525c", "#edf0f2", "#c9ced4"];
    figure.layout.font = { family: 'system-ui, "Segoe UI", Arial, sans-serif', size: 12, color: ink };
    figure.layout.modebar = { bgcolor: "rgba(0,0,0,0)", color: line, activecolor: ink }; // half black over a clear page else
    for (const trace of figure.data) if (!trace.name) trace.hoverinfo ??= "x+y"; // else "trace 1" stands beside it
    for (const [name, axis] of Object.entries(figure.layout))
      if (/^[xy]axis/.test(name)) Object.assign(axis, { gridcolor: grid, linecolor: line, showline: true, ticks: "" });
    return figure;
  }

  const figures = [];
  function draw(dark, width) {
    return Promise.all(figures.map(({ place, text }) => {
      const { data, layout, name } = dressed(text, dark);
      if (width) Object.assign(layout, { width, autosize: false });
      const config = { responsive: true, displaylogo: false, modeBarButtonsToRemove: ["lasso2d", "select2d", "autoScale2d"],
        toImageButtonOptions: { format: "svg", filename: name } };
      return Plotly.react(place, data, layout, config);
    }));
  }

  async function start() {
    const packed = document.getElementById("plotly"); // absent where pages share a bundle beside them
    if (packed) {
      const script = document.createElement("script");
      script.textContent = await unpacked(packed);
      document.head.append(script);
    }
    for (const place of document.querySelectorAll(".figure")) {
      const text = await unpacked(place.querySelector("script"));
      place.replaceChildren();
      figures.push({ place, text });
    }
    await draw(DARK.matches);
    DARK.addEventListener("change", () => draw(DARK.matches));
    addEventListener("beforeprint", () => draw(false, 680));
    addEventListener("afterprint", () => draw(DARK.matches));
    document.documentElement.dataset.figures = "drawn"; // for whoever waits for them
  }

  start().catch((error) => {
    document.documentElement.dataset.figures = "failed";
    for (const place of document.querySelectorAll(".figure"))
      place.textContent = `This figure needs a browser of 2023 or later (${error.message}).`;
  });
})();
