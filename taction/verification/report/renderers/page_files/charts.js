"use strict";
// Charts of Plotly in the colours of the page; used by reports and by the explorer.
const tactionCharts = (() => {
  const coarse = matchMedia("(pointer: coarse)");
  const NARROW = 480;
  let known = {};

  // Colours: the style sheet's variables, which charts take by name.
  const colour = (name) => (known[name] ||= getComputedStyle(document.documentElement).getPropertyValue(name).trim());
  const coloured = (value) => {
    if (typeof value === "string") return /^--[a-z-]+$/.test(value) ? colour(value) : value;
    if (Array.isArray(value)) return value.map(coloured);
    if (value === null || typeof value !== "object") return value;
    return Object.fromEntries(Object.entries(value).map(([key, each]) => [key, coloured(each)]));
  };
  const axis = {
    gridcolor: "--grid", linecolor: "--muted", zerolinecolor: "--muted", tickcolor: "--muted",
    automargin: true, exponentformat: "power", minexponent: 3, zerolinewidth: 1, showline: true,
    title: { standoff: 8, font: { size: 13 } },
  };
  const layoutOf = (spec) => ({
    template: coloured({ layout: {
      xaxis: axis, yaxis: axis, font: { color: "--ink", size: 12,
        family: "system-ui, 'Segoe UI', Roboto, 'Noto Sans', sans-serif" },
      paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", colorway: ["--pass"],
      hoverlabel: { bgcolor: "--card", bordercolor: "--muted", font: { color: "--ink" } },
      legend: { orientation: "h", y: 1.02, yanchor: "bottom", x: 0, bgcolor: "rgba(0,0,0,0)" },
      margin: { l: 48, r: 14, t: 12, b: 44 }, modebar: { bgcolor: "rgba(0,0,0,0)", color: "--muted" },
    } }),
    ...coloured(spec.layout),
    dragmode: coarse.matches ? false : "zoom",
    uirevision: "kept",
  });
  const config = {
    displaylogo: false, responsive: true, displayModeBar: coarse.matches || "hover",
    modeBarButtonsToRemove: ["select2d", "lasso2d", "sendChartToCloud"], plotlyServerURL: "", // nothing is sent
  };
  // Draw the chart `spec` into `canvas`; `more` replaces parts of its layout.
  const draw = (canvas, spec, more = {}) => {
    const data = coloured(spec.data), layout = { ...layoutOf(spec), ...more };
    if ((more.width || canvas.clientWidth) < NARROW) {
      if (layout.xaxis?.dtick === "D2") layout.xaxis.tickangle = -45; // Plotly turns no labels of digits
      data.forEach((each) => {
        delete each.texttemplate;
        each.mode = each.mode?.replace("+text", ""); // a table or the pointer has what has no room
      });
    }
    return Plotly.react(canvas, data, layout, config);
  };
  const empty = (text) => ({ data: [], layout: {
    xaxis: { visible: false }, yaxis: { visible: false },
    annotations: [{ text, showarrow: false, xref: "paper", yref: "paper", x: 0.5, y: 0.5, font: { size: 14, color: "--muted" } }],
  } });
  // The theme is that of the system, or a given one; `repaint` draws the charts again.
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const paint = (theme) => {
    document.documentElement.dataset.theme = theme || (dark.matches ? "dark" : "light");
    known = {};
  };
  const follow = (repaint) => {
    dark.addEventListener("change", () => { paint(); repaint(); });
    paint();
  };
  return { draw, empty, follow, layoutOf, paint };
})();
