// The three pictures of the explorer, drawn on canvases by ECharts.
import { echarts } from "/echarts/index.js";

const made = {};
let colours = {};
const LABEL_HEIGHT = 0.06; // of the axis
const LABELLED = 12; // channels above which curves have no names, targets and bands

const get = (id) => document.getElementById(id);
const css = (name) => colours[name] || (colours[name] = getComputedStyle(document.documentElement).getPropertyValue(name).trim());
export const charts = () => {
  for (const id of ["outputs", "stress", "poles"]) {
    made[id] = echarts.init(get(id), null, { renderer: "canvas" });
    new ResizeObserver(() => made[id].resize()).observe(get(id));
  }
};
export const repaint = () => { colours = {}; };

// Numbers as engineers write them: 12.5 µ, 3 k.
const PREFIXES = ["f", "p", "n", "µ", "m", "", "k", "M", "G", "T"];
export const short = (value, digits = 4) => {
  if (value === 0) return "0 ";
  const power = Math.max(-5, Math.min(4, Math.floor(Math.log10(Math.abs(value)) / 3 + 1e-9)));
  return `${Number((value / 1000 ** power).toPrecision(digits))} ${PREFIXES[power + 5]}`;
};
const floats = (text) => new Float32Array(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer);
const points = (line) => {
  const x = floats(line.x), y = floats(line.y), pairs = new Float64Array(2 * x.length);
  for (let n = 0; n < x.length; n += 1) { pairs[2 * n] = x[n]; pairs[2 * n + 1] = y[n]; }
  return pairs;
};

const axis = (name, unit, more = {}) => ({
  type: "value", name, nameLocation: "middle", nameGap: 28, nameTextStyle: { color: css("--muted") },
  axisLabel: { color: css("--muted"), hideOverlap: true, formatter: (value) => short(value) + unit, showMinLabel: false, showMaxLabel: false },
  axisLine: { show: true, onZero: false, lineStyle: { color: css("--muted") } }, splitLine: { lineStyle: { color: css("--grid") } }, ...more,
});
const base = (grid) => ({
  animation: false, title: { show: false, text: "" }, grid, textStyle: { fontFamily: "system-ui, sans-serif", color: css("--ink") },
  tooltip: { trigger: "item", confine: true, backgroundColor: css("--card"), borderColor: css("--line"), textStyle: { color: css("--ink") } },
});
const put = (id, option) => { made[id].setOption(option, { replaceMerge: ["series"], silent: true }); made[id].getZr().flush(); };
const empty = (id, text) => put(id, { ...base({}), series: [], title: { show: true, text, left: "center", top: "middle", textStyle: { color: css("--muted"), fontSize: 14, fontWeight: 400 } } });

// Outputs with targets and band; ngspice over them. One series has all targets: a mark of each costs.
const targets = ({ targets: levels, colours: lines, band }) => ({
  markLine: { silent: true, symbol: "none", label: { show: false }, animation: false,
    data: levels.map((y, n) => ({ yAxis: y, lineStyle: { color: lines[n], type: "dotted", width: 1 } })) },
  markArea: { silent: true, animation: false,
    data: levels.map((y, n) => [{ yAxis: y - band, itemStyle: { color: lines[n], opacity: 0.14 } }, { yAxis: y + band }]) },
});
// One name for curves whose ends are so close that their names would overlap, at the middle one.
const endNames = (curves) => {
  const ends = curves.lines.map((line, n) => [floats(line.y).at(-1), n]).sort((a, b) => a[0] - b[0]);
  const near = LABEL_HEIGHT * (curves.high - curves.low), groups = [];
  for (const [end, n] of ends) {
    const group = groups.at(-1);
    if (group && end - group.last < near) { group.members.push(n); group.last = end; } else groups.push({ members: [n], last: end });
  }
  const names = curves.lines.map(() => "");
  for (const { members } of groups) {
    names[members[members.length >> 1]] = members.map((n) => n + 1).sort((a, b) => a - b).map((n) => `u${n}`).join(" ");
  }
  return names;
};
export const drawOutputs = (part) => {
  const { curves, other } = part;
  if (!curves) { empty("outputs", part.refused ? "no board with these values" : "computing the waveforms"); get("outputs-note").textContent = ""; return; }
  const count = curves.lines.length, named = count <= LABELLED;
  const names = named ? endNames(curves) : [];
  const series = curves.lines.map((line, n) => ({
    type: "line", id: `u${n + 1}`, name: `u${n + 1}`, data: points(line), dimensions: ["t", "u"], showSymbol: false, silent: false, clip: true,
    lineStyle: { color: curves.colours[n], width: 1.8, type: n >= (count + 1) >> 1 && count > 1 ? "dashed" : "solid" }, itemStyle: { color: curves.colours[n] },
    endLabel: { show: Boolean(names[n]), formatter: names[n] || "", color: curves.colours[n], distance: 4, fontSize: 11 },
    emphasis: { disabled: true },
  }));
  if (named) Object.assign(series[0], targets(curves));
  for (const [n, line] of (other ? other.lines : []).entries()) {
    series.push({ type: "line", id: `ngspice ${n + 1}`, name: "ngspice", data: points(line), dimensions: ["t", "u"], showSymbol: false, silent: true, clip: true, z: 5,
      lineStyle: { color: css("--ink"), width: 2.4, type: [2, 7] }, emphasis: { disabled: true } });
  }
  put("outputs", { ...base({ left: 70, right: named ? 16 + 7 * Math.max(...names.map((name) => name.length)) : 16, top: 12, bottom: 44 }), series,
    xAxis: axis("time", "s", { min: 0, max: curves.end }), yAxis: axis("", "V", { min: curves.low, max: curves.high }),
    tooltip: { ...base({}).tooltip, trigger: "axis", axisPointer: { type: "line", lineStyle: { color: css("--muted") } }, order: "valueDesc",
      formatter: (found) => `${short(found[0].value[0])}s<br>` + found.filter((f) => f.seriesName !== "ngspice").slice(0, LABELLED).map((f) => `${f.marker}${f.seriesName} ${short(f.value[1])}V`).join("<br>") } });
  const notes = [named ? "Dotted: targets; shaded: the settling band." : `${count} channels, the first to the last from blue to orange.`];
  if (count > 1) notes.push("Dashed curves: the second half of the channels.");
  if (curves.source) notes.push(curves.source);
  if (curves.clipped) notes.push(`The picture ends at the supply of ${curves.clipped}: beyond it the linear board is not the board.`);
  if (other) notes.push("Dots on the curves: ngspice.");
  get("outputs-note").textContent = notes.join(" ");
  get("outputs").setAttribute("aria-label", `Outputs of ${count} channels from 0 to ${short(curves.end)}s; ${notes.join(" ")}`);
};

// Stress: truth, solution and the board at rest.
const pairs = (x, y) => x.map((value, n) => [value, y[n]]);
export const drawStress = (part) => {
  const found = part.stress;
  if (!found) { empty("stress", "no board with these values"); get("stress-note").replaceChildren(); return; }
  const lone = found.x.length === 1;
  const series = [];
  if (found.truth) series.push({ type: "line", id: "truth", name: "truth", data: pairs(found.x, found.truth), showSymbol: lone, symbolSize: 14, lineStyle: { color: css("--true"), width: 5, opacity: 0.55 }, itemStyle: { color: css("--true") } });
  series.push({ type: "line", id: "solution", name: "solution", data: pairs(found.x, found.target), symbol: "none", lineStyle: { color: css("--pass"), width: 2, type: "dashed" } });
  series.push({ type: "scatter", id: "board", name: "board", data: pairs(found.x, found.board), symbol: "circle", symbolSize: lone ? 11 : 9, itemStyle: { color: css("--card"), borderColor: css("--fail"), borderWidth: 2.2 } });
  const room = lone ? 1 : 0.04 * (found.x.at(-1) - found.x[0]);
  put("stress", { ...base({ left: 64, right: 16, top: 12, bottom: 44 }), series,
    xAxis: axis(found.along, "", { min: found.x[0] - room, max: found.x.at(-1) + room, axisLabel: { color: css("--muted"), hideOverlap: true, showMinLabel: false, showMaxLabel: false } }),
    yAxis: axis("", "V", { scale: true }),
    tooltip: { ...base({}).tooltip, formatter: (f) => `${f.seriesName} ${short(f.value[1])}V` } });
  const key = (name, style, colour) => {
    const sample = Object.assign(document.createElement("span"), { className: `key ${style}` });
    sample.style.color = css(colour);
    const made_ = document.createElement("span");
    made_.append(sample, name);
    return made_;
  };
  const note = get("stress-note");
  note.className = "note keys";
  note.replaceChildren(...(found.truth ? [key("truth", "", "--true")] : []), key("numerical solution", "dashed", "--pass"), key("board at rest", "dot", "--fail"),
    `Board less solution: at most ${found.off}.${found.error ? ` Solution less truth: ${found.error} of the truth.` : ""}`);
  get("stress").setAttribute("aria-label", `Recovered stress of ${found.x.length} channels. ${note.textContent}`);
};

// Poles in the upper half plane; the half plane where they grow is hatched.
const hatch = () => {
  const size = 10, canvas = Object.assign(document.createElement("canvas"), { width: size, height: size }), pen = canvas.getContext("2d");
  pen.fillStyle = css("--fail-soft"); pen.fillRect(0, 0, size, size);
  pen.strokeStyle = css("--fail-fill"); pen.globalAlpha = 0.45; pen.lineWidth = 1.5;
  for (const shift of [-size, 0, size]) { pen.beginPath(); pen.moveTo(shift, size); pen.lineTo(shift + size, 0); pen.stroke(); }
  return { image: canvas, repeat: "repeat" };
};
export const drawPoles = (part) => {
  const found = part.poles;
  if (!found) { empty("poles", part.refused ? "no board with these values" : "computing the poles"); get("poles-note").textContent = ""; return; }
  const [left, right, top] = found.view;
  const all = pairs(found.x, found.y);
  const dots = (name, data, symbol, colour, hollow) => ({ type: "scatter", id: name, name, data, symbol, symbolSize: hollow ? 9 : 11, clip: true,
    itemStyle: hollow ? { color: css("--card"), borderColor: css(colour), borderWidth: 2 } : { color: css(colour) } });
  const decays = dots("decays", all.filter(([x]) => x < 0), "circle", "--pass", true);
  decays.markArea = { silent: true, itemStyle: { color: hatch() }, label: { show: true, position: "insideTopRight", color: css("--fail"), formatter: "grows" }, data: [[{ xAxis: 0 }, { xAxis: right }]] };
  decays.markLine = { silent: true, symbol: "none", label: { show: false }, lineStyle: { color: css("--ink"), type: "solid", width: 1.5 }, data: [{ xAxis: 0 }] };
  const grows = dots("grows", all.filter(([x]) => x >= 0), "path://M0 2L2 0L5 3L8 0L10 2L7 5L10 8L8 10L5 7L2 10L0 8L3 5Z", "--fail", false);
  put("poles", { ...base({ left: 70, right: 16, top: 12, bottom: 44 }), series: [decays, grows],
    xAxis: axis("real part", "/s", { min: left, max: right }), yAxis: axis("", "Hz", { min: 0, max: top }),
    tooltip: { ...base({}).tooltip, formatter: (f) => `${f.seriesName}: ${short(f.value[0])}/s at ${short(f.value[1])}Hz` } });
  get("poles-note").textContent = `The board is ${part.state}. Rightmost pole: ${found.lead}; damping ratio ${found.damping}.`;
  get("poles").setAttribute("aria-label", `Poles. ${get("poles-note").textContent}`);
};
