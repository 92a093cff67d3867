// The histogram as SVG: counts on a logarithmic scale, the window beneath.

const NAMESPACE = "http://www.w3.org/2000/svg";

function element(name, attributes, text) {
  const made = document.createElementNS(NAMESPACE, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  if (text !== undefined) made.textContent = text;
  return made;
}

export function histogram(root, { counts, range, level, damaged }, window) {
  const [width, height, foot] = [1024, 200, 24];
  const svg = element("svg", { viewBox: `0 0 ${width} ${height + foot}`, preserveAspectRatio: "none", role: "img" });
  svg.setAttribute("aria-label", `Counts of values from ${range[0]} to ${range[1]}, logarithmic`);
  const top = Math.log1p(Math.max(...counts));
  const bar = width / counts.length;
  const x = (value) => range[1] > range[0] ? (value - range[0]) / (range[1] - range[0]) * width : 0;
  const [from, to] = window.map((value) => Math.min(Math.max(x(value), 0), width));
  svg.append(element("rect", { class: "window", x: from, y: 0, width: Math.max(to - from, 1), height }));
  counts.forEach((count, i) => {
    const tall = top > 0 ? Math.log1p(count) / top * height : 0;
    svg.append(element("rect", { class: "bar", x: i * bar, y: height - tall, width: bar, height: tall }));
  });
  svg.append(element("text", { x: 0, y: height + 16 }, range[0]));
  svg.append(element("text", { x: width, y: height + 16, "text-anchor": "end" }, range[1]));
  const note = document.createElement("p");
  note.className = "hint";
  note.textContent = `Of level ${level}.` + (damaged ? ` ${damaged} damaged bricks are not counted.` : "");
  root.replaceChildren(svg, note);
}
