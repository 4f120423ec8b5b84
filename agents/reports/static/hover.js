// Values of a plot's points: under the pointer, under a finger, or by the arrow keys.

const REACH = 40; // pixels

function makeHoverable(plot) {
  const at = (event) => {
    const box = plot.getBoundingClientRect();
    tell(plot, nearestSpot(plot, event.clientX - box.left, event.clientY - box.top));
  };
  plot.addEventListener('pointermove', at);
  plot.addEventListener('pointerdown', at);
  for (const end of ['pointerleave', 'blur']) plot.addEventListener(end, () => tell(plot, null));
  plot.addEventListener('keydown', (event) => {
    const by = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (!by || !plot.drawing?.spots.length) return;
    event.preventDefault();
    const { spots } = plot.drawing;
    tell(plot, spots[(spots.indexOf(plot.told) + by + spots.length) % spots.length]);
  });
}

function nearestSpot(plot, x, y) {
  let [best, least] = [null, REACH ** 2];
  for (const spot of plot.drawing?.spots ?? []) {
    const distance = (spot.px - x) ** 2 + (spot.py - y) ** 2;
    if (distance <= least) [best, least] = [spot, distance];
  }
  return best;
}

// Shows the values of a point, or none.
function tell(plot, spot) {
  if (plot.told === spot) return;
  plot.told = spot;
  for (const old of plot.querySelectorAll('.tip, .spot')) old.remove();
  if (!spot) return;
  const { series, i, px, py } = spot;
  drawn(plot.drawing.svg, 'circle', { class: 'spot', cx: px, cy: py, r: 6 });
  const tip = document.createElement('div');
  const name = document.createElement('b');
  tip.className = 'tip';
  name.textContent = series.name;
  const lines = [`${plot.chart.x.label}: ${valueText(series.x[i])}`, `${plot.chart.y.label}: ${valueText(series.y[i])}`];
  if (series.notes.length) lines.push(series.notes[i]);
  tip.append(name, lines.join('\n'));
  plot.append(tip);
  const { width, height } = tip.getBoundingClientRect();
  const room = plot.getBoundingClientRect();
  tip.style.left = `${clamp(px - width / 2, 0, Math.max(room.width - width, 0))}px`;
  tip.style.top = `${py - height - 14 < -20 ? py + 14 : py - height - 14}px`;
}
