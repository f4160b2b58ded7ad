"use strict";
// Draws the figures of a report: each when it comes near the screen, all of them for printing.
(function () {
  const PRINT_WIDTH = 680, PRINT_PAIR_WIDTH = 330, PRINT_HEIGHT = 165;
  // Pixels around all panels of a figure, heights of text that a tick has, and of a gap of panels.
  const FRAME = 90, LINES_PER_TICK = 1.7, LINES_BETWEEN = 2;
  const touch = matchMedia("(pointer: coarse)").matches;
  const config = {responsive: true, displayModeBar: false, doubleClick: "reset"};
  const canvases = Array.from(document.querySelectorAll(".canvas"));
  const drawn = new Set();

  function token(name) {
    return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  }

  // Colours that depend on light or dark are written as "--name" in the figures.
  function themed(value) {
    if (typeof value === "string") return value.startsWith("--") ? token(value) : value;
    if (!value || typeof value !== "object") return value;
    if (Array.isArray(value)) {
      return typeof value[0] === "object" ? value.map(themed) : value;
    }
    const result = {};
    for (const key of Object.keys(value)) result[key] = themed(value[key]);
    return result;
  }

  // Few enough numbers on a vertical axis, and room between panels, that none lie on one another:
  // a page of paper has less height for the same text.
  function spaced(axis, size, height) {
    const inner = Math.max(height - FRAME, FRAME);
    const [low, high] = axis.domain;
    const bottom = low > 0 ? low + LINES_BETWEEN * size / inner : low;
    const ticks = Math.floor((high - bottom) * inner / (LINES_PER_TICK * size));
    return Object.assign({}, axis, {
      domain: [bottom, high], nticks: Math.max(2, Math.min(9, ticks)),
      title: Object.assign({standoff: 8}, axis.title),
    });
  }

  function layoutOf(figure, width, height) {
    const ink = token("--ink"), grid = token("--grid"), narrow = width < 520;
    // On paper figures are smaller, so that pages are full.
    const size = document.documentElement.hasAttribute("data-print") ? 9 : narrow ? 11 : 12;
    const layout = Object.assign({
      paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
      font: {color: ink, size: size, family: "system-ui, sans-serif"},
      margin: {l: 8, r: 8, t: 8, b: 8}, hovermode: "closest",
      dragmode: touch ? false : "zoom",
      hoverlabel: {bgcolor: token("--raised"), bordercolor: token("--rule"), font: {color: ink}},
      legend: {orientation: "h", x: 0, xanchor: "left", y: 1.02, yanchor: "bottom",
        itemwidth: 30, font: {size: Math.min(size, narrow ? 10 : 12)}},
    }, themed(figure.layout));
    for (const key of Object.keys(layout)) {
      if (!/^[xy]axis/.test(key)) continue;
      layout[key] = Object.assign({
        gridcolor: grid, zerolinecolor: token("--rule"), linecolor: token("--rule"),
        automargin: true, exponentformat: "power", minexponent: 5, nticks: narrow ? 5 : 9,
        ticks: "outside", ticklen: 4, tickcolor: "rgba(0,0,0,0)",
      }, key[0] === "y" ? spaced(layout[key], size, height) : layout[key]);
      if (touch) layout[key].fixedrange = true;
    }
    return layout;
  }

  function draw(canvas) {
    const source = canvas.parentElement.querySelector("script");
    const figure = JSON.parse(source.textContent);
    const printing = document.documentElement.hasAttribute("data-print");
    const width = canvas.clientWidth || PRINT_WIDTH;
    const height = canvas.clientHeight || PRINT_HEIGHT;
    const layout = layoutOf(figure, width, height);
    if (printing) {
      layout.width = canvas.closest(".pair") ? PRINT_PAIR_WIDTH : PRINT_WIDTH;
      layout.autosize = false;
    }
    layout.height = height;
    drawn.add(canvas);
    Plotly.react(canvas, themed(figure.data), layout, config);
  }

  function redraw() { drawn.forEach(draw); }

  const near = new IntersectionObserver(function (entries) {
    for (const entry of entries) {
      if (entry.isIntersecting) { near.unobserve(entry.target); draw(entry.target); }
    }
  }, {rootMargin: "400px"});
  canvases.forEach(function (canvas) { near.observe(canvas); });

  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
  const closed = [];
  addEventListener("beforeprint", function () {
    document.documentElement.setAttribute("data-print", "");
    document.querySelectorAll("details:not([open])").forEach(function (one) {
      one.open = true;
      closed.push(one);
    });
    canvases.forEach(draw);
  });
  addEventListener("afterprint", function () {
    document.documentElement.removeAttribute("data-print");
    closed.splice(0).forEach(function (one) { one.open = false; });
    redraw();
  });
})();
