"use strict";
(() => {
  const root = document.documentElement;
  const all = (query, from = document) => [...from.querySelectorAll(query)];

  // Pictures.
  const canvases = all(".canvas");
  const specs = new Map(canvases.map((canvas) =>
    [canvas, JSON.parse(document.querySelector(`script[data-for="${canvas.id}"]`).textContent)]));
  const draw = (canvas, width) => {
    const spec = specs.get(canvas), kept = { width };
    for (const [name, axis] of Object.entries(canvas.layout || {})) {
      if (/^[xy]axis/.test(name) && spec.layout[name] && axis.range) {
        kept[name] = { ...tactionCharts.layoutOf(spec)[name], range: [...axis.range], autorange: axis.autorange };
      }
    }
    return tactionCharts.draw(canvas, spec, kept);
  };
  const drawAll = (width) => { if (window.Plotly) canvases.forEach((each) => draw(each, width)); };

  // Plotly is packed into the page; the policy of the page knows its digest.
  const unpack = async () => {
    const packed = document.getElementById("plotly");
    if (!packed) { root.dataset.ready = "true"; return; }
    const bytes = Uint8Array.from(atob(packed.textContent), (letter) => letter.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
    const program = document.createElement("script");
    program.textContent = await new Response(stream).text();
    document.head.append(program);
    for (const canvas of canvases) await draw(canvas);
    root.dataset.ready = "true";
  };

  // Tables: a click sorts, the next click turns the order.
  const key = (row, place) => {
    const cell = row.cells[place], number = cell.dataset.number;
    return number === undefined ? cell.textContent.trim() : Number(number);
  };
  const compare = (a, b) => {
    if (typeof a === "number" && typeof b === "number") return a - b;
    if (typeof a === typeof b) return a.localeCompare(b, "en", { numeric: true });
    return typeof a === "number" ? -1 : 1;
  };
  all("table").forEach((table) => all("thead th", table).forEach((head, place) => {
    head.firstElementChild.addEventListener("click", () => {
      const turn = head.getAttribute("aria-sort") === "ascending" ? -1 : 1;
      all("thead th", table).forEach((each) => each.removeAttribute("aria-sort"));
      head.setAttribute("aria-sort", turn > 0 ? "ascending" : "descending");
      const rows = all("tbody tr", table);
      rows.sort((a, b) => turn * compare(key(a, place), key(b, place)));
      table.tBodies[0].append(...rows);
    });
  }));

  // Paper is light.
  const repaint = (theme, width) => { tactionCharts.paint(theme); drawAll(width); };
  addEventListener("beforeprint", () => repaint("light", 680));
  addEventListener("afterprint", () => repaint());
  tactionCharts.follow(drawAll);
  unpack().catch((error) => {
    root.dataset.ready = "failed";
    canvases.forEach((each) => { each.textContent = `This browser cannot draw the picture: ${error}`; });
  });
})();
