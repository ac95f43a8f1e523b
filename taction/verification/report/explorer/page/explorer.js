// The page of the explorer: sliders to the server, its answers into pictures and texts.
const get = (id) => document.getElementById(id);
const make = (tag, properties = {}, ...children) => {
  const element = Object.assign(document.createElement(tag), properties);
  element.append(...children);
  return element;
};
const GIVE_UP = 8000; // ms without an answer, after which newer values are sent
const state = { start: null, waiting: false, sent: 0, pending: null, dragged: "", window: "rise", part: {}, controls: new Map() };

// Values to the server: at most one message is under way, and the last values always win.
const ask = (change) => {
  const pending = state.pending || (state.pending = { places: {}, texts: {} });
  Object.assign(pending.places, change.places);
  Object.assign(pending.texts, change.texts);
  for (const key of ["opamp", "reset"]) if (key in change) pending[key] = change[key];
  pending.stamp = performance.now();
  outdated();
  flush();
};
const flush = () => {
  if (!state.pending) return;
  if (state.waiting && performance.now() - state.sent < GIVE_UP) return;
  const message = state.pending;
  state.pending = null;
  state.waiting = true;
  state.sent = performance.now();
  emitEvent("taction-move", message);
};

const outdated = () => {
  for (const id of ["readings", "checks"]) get(id).classList.add("old");
  get("verdict-text").textContent = "verdict of earlier values; computing";
  get("verdict-mark").replaceChildren();
};

// Controls.
const buildControls = (start) => {
  get("name").textContent = start.name;
  get("file").textContent = start.file;
  get("save-name").value = start.saved;
  get("controls").replaceChildren(...start.controls.map((each, n) => control(each, start.steps, n)));
  const own = make("option", { value: "", textContent: `as in the scene (${start.own_opamp})` });
  get("opamp").replaceChildren(own, ...start.opamps.map((name) => make("option", { value: name, textContent: name })));
};
const control = (each, steps, n) => {
  const name = `${each.symbol}, ${each.name}`;
  const slider = make("input", { type: "range", min: 0, max: steps, step: 1, value: each.place, id: `slider-${n}` });
  slider.setAttribute("aria-label", name);
  const text = make("input", { type: "text", value: each.text, spellcheck: false, id: `value-${n}` });
  text.setAttribute("aria-label", `value of ${name}`);
  slider.addEventListener("input", () => {
    state.dragged = each.path;
    ask({ places: { [each.path]: Number(slider.value) } });
  });
  slider.addEventListener("change", () => { state.dragged = ""; });
  text.addEventListener("change", () => ask({ texts: { [each.path]: text.value } }));
  text.addEventListener("keydown", (event) => {
    if (event.key === "Enter") { event.preventDefault(); text.blur(); }
    if (event.key === "Escape") { text.value = state.part.values?.[each.path].text ?? each.text; text.blur(); }
  });
  const head = make("div", { className: "control-head" }, make("b", { textContent: each.symbol }),
    make("span", { className: "control-name", textContent: each.name }), text);
  const ends = make("div", { className: "ends" }, make("span", { textContent: each.low }), make("span", { textContent: each.high }));
  ends.setAttribute("aria-hidden", "true");
  const along = make("div", { className: "along" });
  along.setAttribute("role", "img");
  const mistake = make("p", { className: "mistake", id: `mistake-${n}` });
  mistake.setAttribute("role", "alert");
  text.setAttribute("aria-describedby", mistake.id);
  const made = make("div", { className: "control" }, head, mistake, slider, along, ends);
  made.dataset.path = each.path;
  if (n === 0) {
    const stable = make("div", { className: "stable unknown", id: "stable" });
    stable.setAttribute("aria-hidden", "true");
    along.before(stable);
    made.append(make("p", { className: "stable-text", id: "stable-text", textContent: `stable values of ${each.symbol}: computing` }));
  }
  state.controls.set(each.path, { slider, text, along, name, mistake });
  return made;
};
const showValues = (values, wrong, said) => {
  for (const [path, value] of Object.entries(values)) {
    const { slider, text, mistake } = state.controls.get(path);
    mistake.textContent = wrong.includes(path) ? said : "";
    if (wrong.includes(path)) { text.setAttribute("aria-invalid", "true"); continue; }
    if (state.pending && path in state.pending.places) continue;
    if (state.dragged !== path) slider.value = value.place;
    slider.setAttribute("aria-valuetext", value.text);
    if (document.activeElement !== text) text.value = value.text;
    text.classList.toggle("changed", !value.own);
    text.removeAttribute("aria-invalid");
  }
};

// Texts.
const mark = (outcome) => {
  const shape = make("span", { className: "shape" });
  shape.setAttribute("aria-hidden", "true");
  return make("span", { className: `mark mark-${outcome}` }, shape, outcome === "error" ? "no verdict" : outcome);
};
const rows = (entries) => Object.entries(entries).map(([name, value]) =>
  make("div", {}, make("dt", { textContent: name }), make("dd", { textContent: value })));
const items = (texts) => texts.map((text) => make("li", { textContent: text }));
const SVG = "http://www.w3.org/2000/svg";
const drawn = (tag, attributes) => {
  const element = document.createElementNS(SVG, tag);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  return element;
};
const bar = (check) => {
  const head = make("div", { className: "bar-head" }, make("span", { className: "bar-name", textContent: check.name }),
    mark(check.outcome), make("span", { className: "bar-value", textContent: check.value }),
    make("span", { className: "bar-limit", textContent: check.limit }));
  const row = make("li", { className: "bar-row" }, head);
  if (check.share !== null) {
    const picture = drawn("svg", { class: "bar", viewBox: "0 0 300 14", preserveAspectRatio: "none", role: "img", "aria-label": `${check.name}: ${check.used} of the limit` });
    picture.append(drawn("rect", { class: "bar-ground", x: 0, y: 2, width: 300, height: 10 }),
      drawn("rect", { class: `bar-fill fill-${check.outcome}`, x: 0, y: 2, width: check.width, height: 10 }),
      drawn("path", { class: "bar-edge", d: "M200 0V14" }));
    row.append(picture);
  }
  if (check.reason) row.append(make("p", { className: "reason", textContent: check.reason }));
  return row;
};
const showVerdict = (verdict) => {
  for (const id of ["readings", "checks"]) get(id).classList.remove("old");
  get("verdict-mark").replaceChildren(mark(verdict.outcome));
  get("head").className = `head outcome-${verdict.outcome}`;
  get("verdict-text").textContent = verdict.text;
  if (verdict.outcome === "error") {
    get("readings").replaceChildren();
    get("checks").replaceChildren();
    get("warnings").replaceChildren(...items([verdict.error]));
    return;
  }
  get("readings").replaceChildren(...rows(verdict.figures));
  get("checks").replaceChildren(...verdict.checks.map(bar));
  get("warnings").replaceChildren(...items(verdict.warnings));
};
const showRefused = () => {
  get("verdict-text").textContent = "no board with these values";
  get("verdict-mark").replaceChildren(mark("error"));
};
const showBoundary = (boundary) => {
  const bars = boundary.parts.map(([low, high]) => {
    const part = make("div");
    part.style.left = `${100 * low}%`;
    part.style.width = `${100 * (high - low)}%`;
    return part;
  });
  get("stable").classList.toggle("unknown", boundary.unknown);
  get("stable").replaceChildren(...bars);
  get("stable-text").textContent = `stable values of ${state.start.controls[0].symbol}: ${boundary.text}`;
};
// Below each slider: the outcome of all checks at some of its values.
const showAlong = (cells) => {
  for (const [path, spots] of Object.entries(cells)) {
    const { along, name } = state.controls.get(path);
    along.replaceChildren(...spots.map((spot) => make("div", { className: `cell-${spot.outcome}`, title: spot.text })));
    along.setAttribute("aria-label", `checks along ${name}: ${spots.map((spot) => spot.text).join("; ")}`);
  }
};
const showDoubts = () => {
  const { refused, doubts = [], limits = [] } = state.part;
  get("doubts").replaceChildren(...items([...(refused ? [refused] : []), ...doubts, ...limits]));
  requestAnimationFrame(() => document.documentElement.style.setProperty("--head", `${get("head").offsetHeight + 14}px`));
};
const showSimulation = (found) => {
  if (found.outcome === "error") { get("simulation").textContent = `no result: ${found.error}`; return; }
  const { figures } = found;
  const apart = found.difference ? `largest difference from the state-space engine ${found.difference} of the step` : "not compared with the state-space engine";
  get("simulation").textContent = `${found.engine}: ${found.outcome} in ${found.seconds}; ${apart}; `
    + Object.entries(figures).map(([name, value]) => `${name} ${value}`).join(", ") + `. ${found.reasons.join("; ")}`;
};

// Answers from the server.
const FRESH = ["outputs", "poles", "stress", "doubts", "limits", "refused"];
const show = (part) => {
  if (part.start) { state.start = part.start; buildControls(part.start); return; }
  if ("values" in part) {
    state.waiting = false;
    const same = part.same || [];
    if ("cost" in part || part.refused) for (const key of FRESH) if (!same.includes(key)) delete state.part[key];
    flush();
    const wrong = (part.wrong || []).filter((path) => state.controls.has(path));
    showValues(part.values, wrong, part.mistake);
    if (part.mistake && "refused" in state.part) showRefused(); // nothing has changed
    else if (part.mistake && state.judged === part.number) showVerdict(state.part.verdict);
    get("opamp").value = part.opamp;
    get("command").textContent = part.command;
    get("mistake").textContent = wrong.length ? "" : part.mistake || "";
  }
  Object.assign(state.part, part);
  if ("refused" in part) showRefused();
  if ("simulating" in part) {
    get("simulate").disabled = part.simulating;
    get("cancel").hidden = !part.simulating;
    if (part.simulating) get("simulation").textContent = "ngspice is running; the page stays usable";
    else if (!part.simulation) get("simulation").textContent = "ended without a result for these values";
  } else if ("cost" in part) {
    get("simulation").textContent = "Its waveforms are laid over the outputs.";
  }
  if (part.simulation) showSimulation(part.simulation);
  if ("saved" in part) get("saved").textContent = part.saved ? `wrote ${part.saved}` : part.save_mistake;
  if (part.facts) get("facts").replaceChildren(...rows(part.facts));
  if (part.boundary) showBoundary(part.boundary);
  if (part.along) showAlong(part.along);
  if (part.verdict) { state.judged = part.number; showVerdict(part.verdict); }
  if (part.verdict && (state.waiting || state.pending)) outdated(); // it is of earlier values
  if (["refused", "doubts", "limits", "cost"].some((key) => key in part)) showDoubts();
  draw(part);
};
// A chart comes as data and layout of Plotly, with its caption.
const EMPTY = { outputs: "computing the waveforms", poles: "computing the poles", stress: "" };
const drawChart = (id) => {
  const chart = state.part[id], caption = chart ? chart.note : "";
  const text = "refused" in state.part ? "no board with these values" : EMPTY[id];
  const more = id === "outputs" ? { hovermode: "x unified", uirevision: state.window } : {};
  tactionCharts.draw(get(id), chart || tactionCharts.empty(text), more);
  get(`${id}-note`).textContent = caption;
  get(id).setAttribute("aria-label", `${get(`${id}-title`).textContent}. ${caption || text}`);
};
const draw = (part) => { // the curves first, the other charts behind them
  const all = "cost" in part || "refused" in part;
  if (all || "outputs" in part) {
    drawChart("outputs");
    if (part.stamp && "outputs" in part) measured(part);
  }
  setTimeout(() => {
    if ("stress" in part || "refused" in part) drawChart("stress");
    if (all || "poles" in part) drawChart("poles");
  });
};
const measured = ({ stamp, cost }) => requestAnimationFrame(() => {
  const time = performance.now() - stamp;
  (window.tactionLatency ||= []).push(time);
  if (window.tactionLatency.length > 1000) window.tactionLatency.shift();
  get("foot").textContent = `the curves came ${time.toFixed(0)} ms after the hand, ${(1000 * cost).toFixed(0)} ms of it for the board`;
  (window.tactionCost ||= []).push(1000 * cost);
});

// Buttons.
const press = (group, chosen) => group.forEach((button) => button.setAttribute("aria-pressed", button === chosen));
const wire = () => {
  const windows = [...document.querySelectorAll("[data-window]")];
  windows.forEach((button) => button.addEventListener("click", () => {
    press(windows, button);
    state.window = button.dataset.window;
    emitEvent("taction-window", state.window);
  }));
  get("opamp").addEventListener("change", () => ask({ opamp: get("opamp").value }));
  get("reset").addEventListener("click", () => ask({ reset: true }));
  get("hand").addEventListener("submit", (event) => event.preventDefault());
  get("simulate").addEventListener("click", () => emitEvent("taction-simulate"));
  get("cancel").addEventListener("click", () => emitEvent("taction-cancel"));
  get("save").addEventListener("submit", (event) => { event.preventDefault(); emitEvent("taction-save", get("save-name").value); });
  get("copy").addEventListener("click", async () => {
    await navigator.clipboard.writeText(get("command").textContent).catch(() => getSelection().selectAllChildren(get("command")));
    get("copied").textContent = "copied";
  });
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const themes = [...document.querySelectorAll("[data-theme-choice]")];
  let choice = "auto";
  const paint = () => {
    document.documentElement.dataset.theme = choice === "auto" ? (dark.matches ? "dark" : "light") : choice;
    tactionCharts.forget();
    draw({ refused: "" });
  };
  themes.forEach((button) => button.addEventListener("click", () => { choice = button.dataset.themeChoice; press(themes, button); paint(); }));
  dark.addEventListener("change", paint);
  paint();
};

// Begin once NiceGUI has put the page into the document and has a socket.
const begin = () => {
  if (!get("explorer") || !window.did_handshake) { setTimeout(begin, 20); return; }
  wire();
  window.taction = show;
  outdated();
  get("verdict-text").textContent = "computing";
  emitEvent("taction-ready");
  document.documentElement.dataset.ready = "true";
};
begin();
