// Charts: drawn as SVG as wide as there is room, from the data beside them.

const DASHES = '6 4';
const SVG = 'http://www.w3.org/2000/svg';

function drawn(parent, name, attributes, text) {
  const element = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  if (text !== undefined) element.textContent = text;
  parent.append(element);
  return element;
}

// The data of a figure, its numbers unpacked.
function chartOf(figure) {
  const { x, y, series } = JSON.parse(figure.querySelector('script').textContent);
  return { x, y, series: series.map((each) => ({ ...each, x: unpacked(each.x), y: unpacked(each.y) })) };
}

const colourOf = ({ colour }) => `var(--series-${colour})`;

function drawChart(plot, chart) {
  const { width, height } = plot.getBoundingClientRect();
  plot.replaceChildren();
  const svg = drawn(plot, 'svg', { viewBox: `0 0 ${width} ${height}`, 'aria-hidden': 'true' });
  const all = (key) => chart.series.flatMap((each) => [...each[key]]);
  const box = { left: 54, right: width - 10, top: 26, bottom: height - 44 };
  const x = scaled(chart.x, all('x'), box.left, box.right, width / 75);
  const y = scaled(chart.y, all('y'), box.bottom, box.top, 6);
  drawAxes(svg, chart, box, x, y);
  const spots = chart.series.flatMap((each) => drawSeries(svg, each, x, y));
  drawNames(svg, spots, box);
  return { svg, spots };
}

function drawAxes(svg, chart, box, x, y) {
  for (const tick of x.ticks) {
    drawn(svg, 'line', { class: 'grid', x1: x.place(tick), x2: x.place(tick), y1: box.top, y2: box.bottom });
    drawn(svg, 'text', { x: x.place(tick), y: box.bottom + 17, 'text-anchor': 'middle' }, tickText(tick));
  }
  for (const tick of y.ticks) {
    drawn(svg, 'line', { class: 'grid', x1: box.left, x2: box.right, y1: y.place(tick), y2: y.place(tick) });
    drawn(svg, 'text', { x: box.left - 7, y: y.place(tick) + 4, 'text-anchor': 'end' }, tickText(tick));
  }
  drawn(svg, 'text', { x: 0, y: 14 }, chart.y.label);
  drawn(svg, 'text', { x: box.right, y: box.bottom + 36, 'text-anchor': 'end' }, chart.x.label);
}

// Draws a series; returns its points on the screen.
function drawSeries(svg, series, x, y) {
  const spots = [];
  let path = '';
  let joined = false;
  for (let i = 0; i < series.x.length; i++) {
    const [px, py] = [x.place(series.x[i]), y.place(series.y[i])];
    const shown = Number.isFinite(px) && Number.isFinite(py) && x.within(series.x[i]) && y.within(series.y[i]);
    if (shown) {
      path += `${joined ? 'L' : 'M'}${px.toFixed(1)} ${py.toFixed(1)}`;
      spots.push({ series, i, px, py });
    }
    joined = shown;
  }
  const colour = colourOf(series);
  if (series.line !== 'none') {
    const line = drawn(svg, 'path', { d: path, fill: 'none', 'stroke-width': series.width, 'stroke-linejoin': 'round' });
    line.style.stroke = colour;
    if (series.line === 'dashed') line.setAttribute('stroke-dasharray', DASHES);
  }
  if (series.marks) {
    for (const { i, px, py } of spots) {
      const mark = drawn(svg, 'circle', { cx: px.toFixed(1), cy: py.toFixed(1), r: series.line === 'none' && series.x.length > 30 ? 2 : 4 });
      mark.style.fill = series.hollow.includes(i) ? 'var(--card)' : colour;
      mark.style.stroke = colour;
    }
  }
  if (series.named && spots.length) spots.at(-1).named = true;
  return spots;
}

// Writes names beside their points, as near to them as there is room.
function drawNames(svg, spots, box) {
  const taken = spots.map(({ px, py }) => ({ left: px - 4, right: px + 4, y: py, high: 9 }));
  const covers = (one, other) => one.left < other.right && other.left < one.right && Math.abs(one.y - other.y) < other.high;
  const free = (one) => one.y > box.top && one.y < box.bottom && !taken.some((other) => covers(one, other));
  const named = spots.filter((spot) => spot.named).sort((one, other) => one.py - other.py);
  for (const { series, px, py } of named) {
    const text = drawn(svg, 'text', { class: 'name' }, series.name);
    text.style.fill = colourOf(series);
    const width = text.getComputedTextLength();
    const onRight = px + 10 + width <= box.right || px - 10 - width < box.left;
    const left = onRight ? Math.min(px + 10, box.right - width) : px - 10 - width;
    const at = { left, right: left + width, y: py, high: 16 };
    for (let away = 0; away < 60 && !free(at); away++) at.y = py + 3 * Math.ceil(away / 2) * (away % 2 ? 1 : -1);
    taken.push(at);
    text.setAttribute('x', at.left);
    text.setAttribute('y', at.y + 4);
    if (Math.abs(at.y - py) > 10) {
      svg.insertBefore(drawn(svg, 'line', { class: 'leader', x1: px, y1: py, x2: onRight ? at.left - 2 : at.right + 2, y2: at.y }), text);
    }
  }
}

// What the colours mean, unless the names stand in the plot.
function legendOf({ series }) {
  const list = document.createElement('ul');
  list.className = 'legend';
  const names = new Map(series.filter(({ named }) => !named).map((each) => [each.name, each]));
  for (const [name, each] of names) {
    const entry = document.createElement('li');
    const key = document.createElement('i');
    key.style.background = each.line === 'dashed' ? `repeating-linear-gradient(90deg, ${colourOf(each)} 0 4px, transparent 4px 6px)` : colourOf(each);
    entry.append(key, name);
    list.append(entry);
  }
  return list;
}

// Plots are drawn when they come into view, and again when their width changes.
const resized = new ResizeObserver((entries) => {
  for (const { target } of entries) if (target.chart) show(target);
});

const seen = new IntersectionObserver((entries) => {
  for (const { target, isIntersecting } of entries) {
    if (!isIntersecting || target.chart) continue;
    target.chart = chartOf(target.closest('figure'));
    show(target);
    if (target.chart.series.length > 1) target.closest('figure').append(legendOf(target.chart));
    resized.observe(target);
  }
}, { rootMargin: '400px' });

function show(plot) {
  const { width } = plot.getBoundingClientRect();
  if (plot.width === width) return;
  plot.width = width;
  plot.drawing = drawChart(plot, plot.chart);
}

for (const plot of document.querySelectorAll('.plot')) {
  seen.observe(plot);
  makeHoverable(plot);
}
