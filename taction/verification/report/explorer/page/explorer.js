// The page of the explorer: sliders to the server, its answers into the page.
const get = (id) => document.getElementById(id);
const GIVE_UP = 8000; // ms without an answer, after which newer values are sent
const state = { waiting: false, sent: 0, pending: null, dragged: "", window: "rise", charts: {}, values: {}, refused: false };
const controls = new Map();

// Values to the server: at most one message is under way, and the last values always win.
const ask = (change) => {
  const pending = state.pending || (state.pending = { places: {}, texts: {} });
  Object.assign(pending.places, change.places);
  Object.assign(pending.texts, change.texts);
  for (const key of ["opamp", "reset"]) if (key in change) pending[key] = change[key];
  outdated(true);
  flush();
};
const flush = () => {
  if (!state.pending) return;
  if (state.waiting && performance.now() - state.sent < GIVE_UP) return;
  send("move", state.pending);
  Object.assign(state, { pending: null, waiting: true, sent: performance.now() });
};
// Whether the page waits for the verdict: that of earlier values is hidden.
const outdated = (waits) => {
  for (const id of ["readings", "checks"]) get(id).classList.toggle("old", waits);
  get("head").classList.toggle("waits", waits);
  get("simulate").disabled = waits;
};

// Controls.
const wireControl = (control) => {
  const { path } = control.dataset, [text, slider] = control.querySelectorAll("input");
  controls.set(path, { text, slider, mistake: control.querySelector(".mistake") });
  slider.addEventListener("input", () => {
    state.dragged = path;
    ask({ places: { [path]: Number(slider.value) } });
  });
  slider.addEventListener("change", () => { state.dragged = ""; });
  text.addEventListener("change", () => ask({ texts: { [path]: text.value } }));
  text.addEventListener("keydown", (event) => {
    if (event.key === "Enter") { event.preventDefault(); text.blur(); }
    if (event.key === "Escape") { text.value = state.values[path]?.text ?? text.defaultValue; text.blur(); }
  });
};
const showValues = (values, wrong, said) => {
  state.values = values;
  for (const [path, value] of Object.entries(values)) {
    const { slider, text, mistake } = controls.get(path);
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

// Answers from the server: markup for some elements, values, and charts.
const CHARTS = { outputs: "computing the waveforms", poles: "computing the poles", stress: "" };
const show = (part) => {
  const fresh = "stress" in part || "refused" in part;
  if (fresh) {
    ["refused", "doubts", "limits"].forEach((id) => get(id).replaceChildren());
    state.charts = {};
    state.refused = "refused" in part;
  }
  for (const each of new DOMParser().parseFromString(part.html, "text/html").querySelectorAll("[data-into]")) {
    get(each.dataset.into).replaceChildren(...each.childNodes);
  }
  if ("values" in part) {
    state.waiting = false;
    flush();
    const wrong = (part.wrong || []).filter((path) => controls.has(path));
    showValues(part.values, wrong, part.mistake);
    if (part.mistake && !state.pending && (state.refused || state.judged === part.number)) outdated(false); // nothing has changed
    get("opamp").value = part.opamp;
    get("mistake").textContent = wrong.length ? "" : part.mistake || "";
  }
  if ("outcome" in part) {
    state.judged = part.number;
    get("head").className = `head outcome-${part.outcome}`;
    outdated(state.waiting || Boolean(state.pending)); // it may be of earlier values
  }
  if ("scene" in part) {
    const href = URL.createObjectURL(new Blob([part.scene], { type: "text/plain" }));
    Object.assign(document.createElement("a"), { href, download: "explored.toml" }).click();
  }
  if ("refused" in part) outdated(false);
  requestAnimationFrame(() => document.documentElement.style.setProperty("--head", `${get("head").offsetHeight + 14}px`));
  draw(part, fresh);
};
// A chart comes as data and layout of Plotly, with its caption.
const drawChart = (id) => {
  const chart = state.charts[id], caption = chart ? chart.note : "";
  const text = state.refused ? "no board with these values" : CHARTS[id];
  const more = id === "outputs" ? { hovermode: "x unified", uirevision: state.window } : {};
  tactionCharts.draw(get(id), chart || tactionCharts.empty(text), more);
  get(`${id}-note`).textContent = caption;
  get(id).setAttribute("aria-label", `${get(`${id}-title`).textContent}. ${caption || text}`);
};
const draw = (part, all) => { // the curves first, the other charts behind them
  const changed = Object.keys(CHARTS).filter((id) => all || id in part);
  for (const id of changed) if (id in part) state.charts[id] = part[id];
  if (changed.includes("outputs")) drawChart("outputs");
  setTimeout(() => changed.filter((id) => id !== "outputs").forEach(drawChart));
};

const wire = () => {
  document.querySelectorAll(".control[data-path]").forEach(wireControl);
  const windows = [...document.querySelectorAll("[data-window]")];
  windows.forEach((button) => button.addEventListener("click", () => {
    windows.forEach((each) => each.setAttribute("aria-pressed", each === button));
    state.window = button.dataset.window;
    send("window", state.window);
  }));
  get("opamp").addEventListener("change", () => ask({ opamp: get("opamp").value }));
  get("simulate").addEventListener("click", () => { if (!state.refused) { outdated(true); send("simulate"); } });
  get("save").addEventListener("click", () => send("save"));
  get("reset").addEventListener("click", () => ask({ reset: true }));
  get("hand").addEventListener("submit", (event) => event.preventDefault());
  tactionCharts.follow(() => draw({}, true));
};

const socket = new WebSocket(`ws://${location.host}/talk`);
const send = (kind, given = {}) => socket.send(JSON.stringify([kind, given]));
socket.addEventListener("message", (event) => show(JSON.parse(event.data)));
socket.addEventListener("close", () => { get("verdict-text").textContent = "the explorer has ended"; outdated(false); });
socket.addEventListener("open", () => {
  wire();
  draw({}, true);
  outdated(true);
  send("move");
  document.documentElement.dataset.ready = "true";
});
