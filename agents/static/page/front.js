// The front: a chart to drag along, the chosen gait, and the policy as a ghost.

const CHEAPEST = GAITS.reduce((best, gait) => (gait.cot < best.cot ? gait : best));

const front = {
  gait: CHEAPEST,
  time: 0,
  begun: 0, // the time at which this gait was chosen
  playing: !matchMedia('(prefers-reduced-motion: reduce)').matches,
  ghost: new Walker(DATA.machine, (state, p) => policyVoltage(state, p, DATA.machine)),
};

const whirls = (gait) => gait.turns !== 0;
const gaitColour = (gait) => (whirls(gait) ? COLOURS.whirl : COLOURS.swing);

// The least cost of transport at a speed, linear between gaits; NaN off the front.
function optimumAt(speed) {
  const i = GAITS.findIndex((gait) => gait.speed >= speed);
  if (i <= 0) return i === 0 && GAITS[0].speed - speed < 1e-9 ? GAITS[0].cot : NaN;
  const [a, b] = [GAITS[i - 1], GAITS[i]];
  return mix(a.cot, b.cot, (speed - a.speed) / (b.speed - a.speed));
}

// -- the chart -------------------------------------------------------------------------------

const CHART = { left: 46, right: 12, top: 12, bottom: 34, speeds: [0, 1.5], costs: [0.03, 2] };

function chartScales(width, height) {
  const { left, right, top, bottom, speeds, costs } = CHART;
  const share = (cot) => Math.log(cot / costs[0]) / Math.log(costs[1] / costs[0]);
  return {
    x: (speed) => left + ((speed - speeds[0]) / (speeds[1] - speeds[0])) * (width - left - right),
    y: (cot) => height - bottom - share(clamp(cot, ...costs)) * (height - top - bottom),
    speed: (x) => speeds[0] + ((x - left) / (width - left - right)) * (speeds[1] - speeds[0]),
  };
}

function drawChart(canvas) {
  const { ctx, width, height } = cleared(canvas);
  const { x, y } = chartScales(width, height);
  ctx.lineWidth = 1;
  ctx.strokeStyle = COLOURS.line;
  ctx.fillStyle = COLOURS.soft;
  ctx.textBaseline = 'middle';
  ctx.textAlign = 'right';
  for (const cot of [0.03, 0.1, 0.3, 1]) {
    ctx.beginPath();
    ctx.moveTo(x(0), y(cot));
    ctx.lineTo(x(1.5), y(cot));
    ctx.stroke();
    ctx.fillText(`${cot}`, x(0) - 8, y(cot));
  }
  ctx.textBaseline = 'top';
  ctx.textAlign = 'center';
  for (const speed of [0, 0.5, 1]) ctx.fillText(`${speed}`, x(speed), y(CHART.costs[0]) + 7);
  ctx.textAlign = 'right';
  ctx.fillText('1.5 m/s', x(1.5), y(CHART.costs[0]) + 7);
  ctx.textAlign = 'left';
  ctx.fillText('cost of transport', x(0) + 6, CHART.top - 4);
  ctx.lineWidth = 3;
  for (let i = 1; i < GAITS.length; i++) {
    const [a, b] = [GAITS[i - 1], GAITS[i]];
    ctx.strokeStyle = gaitColour(b);
    ctx.beginPath();
    ctx.moveTo(x(a.speed), y(a.cot));
    ctx.lineTo(x(b.speed), y(b.cot));
    ctx.stroke();
  }
  for (const gait of GAITS) {
    ctx.fillStyle = gaitColour(gait);
    ctx.beginPath();
    ctx.arc(x(gait.speed), y(gait.cot), 3.2, 0, 7);
    ctx.fill();
  }
  ctx.font = `600 14px ${FONT}`;
  ctx.textBaseline = 'middle';
  ctx.textAlign = 'left';
  ctx.fillStyle = COLOURS.whirl;
  ctx.fillText('it whirls', x(0.27), y(0.15));
  ctx.fillStyle = COLOURS.swing;
  ctx.fillText('it swings', x(0.93), y(0.14));
  drawGhostMark(ctx, x, y);
  drawChosen(ctx, x, y, height);
}

function drawGhostMark(ctx, x, y) {
  const { speed, cot } = front.ghost.recent(KEPT);
  if (!(speed > 0.05 && cot < CHART.costs[1])) return;
  const [px, py] = [x(Math.min(speed, 1.45)), y(cot)];
  ctx.fillStyle = COLOURS.ghost;
  ctx.beginPath();
  ctx.moveTo(px, py - 8);
  ctx.lineTo(px + 8, py);
  ctx.lineTo(px, py + 8);
  ctx.lineTo(px - 8, py);
  ctx.fill();
  ctx.textAlign = 'center';
  ctx.fillText('policy', px, py < CHART.top + 48 ? py + 18 : py - 17); // clear of the chart's title
}

function drawChosen(ctx, x, y, height) {
  const { gait } = front;
  const [px, py] = [x(gait.speed), y(gait.cot)];
  ctx.strokeStyle = gaitColour(gait);
  ctx.setLineDash([3, 4]);
  ctx.lineWidth = 1.5;
  ctx.beginPath();
  ctx.moveTo(px, py);
  ctx.lineTo(px, height - CHART.bottom);
  ctx.stroke();
  ctx.setLineDash([]);
  ctx.fillStyle = gaitColour(gait);
  ctx.font = `700 16px ${FONT}`;
  ctx.textAlign = whirls(gait) ? 'left' : 'right';
  ctx.fillText(costText(gait.cot), px + (whirls(gait) ? 14 : -12), py - (whirls(gait) ? 2 : 15));
  ctx.fillStyle = COLOURS.card;
  ctx.lineWidth = 4;
  ctx.beginPath();
  ctx.arc(px, py, 9, 0, 7);
  ctx.fill();
  ctx.stroke();
}

// What the pendulum does in a gait, in words.
function motionOf({ turns, starts }) {
  if (turns === 0) return 'swings';
  const count = Math.abs(turns);
  const often = ['once', 'twice'][count - 1] ?? `${count} times`;
  return `turns ${often} ${starts.length === 1 ? 'a step' : `in ${starts.length} steps`}`;
}

// -- choosing a gait --------------------------------------------------------------------------

const SPENT = [
  ['collision', 'collisions', 'collision'],
  ['copper', "motor's windings", 'copper'],
  ['friction', 'friction and gear', 'friction'],
  ['idle', 'electronics', 'idle'],
  ['returned', 'braking', 'returned'],
];

function choose(gait) {
  if (gait !== front.gait) {
    front.begun = front.time;
    front.gait = gait;
  }
  const i = GAITS.indexOf(gait);
  const chart = byId('chart');
  chart.setAttribute('aria-valuenow', i);
  const cot = costText(gait.cot);
  const does = motionOf(gait);
  chart.setAttribute('aria-valuetext', `${fixed(gait.speed, 2)} metres per second, cost of transport ${cot}, the pendulum ${does}`);
  document.querySelector('.caption .solid').style.background = `var(--${whirls(gait) ? 'whirl' : 'swing'})`;
  byId('front-caption').textContent = `optimum at ${fixed(gait.speed, 2)} m/s`;
  byId('gait-title').innerHTML = `<b>${fixed(gait.speed, 2)} m/s</b> at a cost of transport of <b>${cot}</b>: the pendulum ${does}`;
  showSpent(gait);
}

// Where the energy of a metre goes.
function showSpent(gait) {
  const length = gait.speed * gait.duration;
  const { damping, drag, windage, gear, friction, ...others } = gait.spent;
  const joules = { ...others, friction: friction + gear + damping + drag + windage };
  const total = Object.values(joules).reduce((a, b) => a + b, 0);
  const parts = SPENT.map(([key, text, colour]) => ({ text, colour, share: joules[key] / total, perMetre: joules[key] / length }));
  byId('spent').innerHTML = parts.map(({ share, colour }) => `<span style="width:${100 * share}%;background:var(--${colour})"></span>`).join('');
  byId('spent').setAttribute('aria-label', `Where the energy goes: ${parts.map(({ text, share }) => `${text} ${Math.round(100 * share)} %`).join(', ')}`);
  byId('spent-legend').innerHTML = `<li class="total">a metre costs ${fixed(total / length, 2)} J</li>${parts
    .filter(({ share }) => share > 0.0005)
    .map(({ text, colour, perMetre }) => `<li><i style="background:var(--${colour})"></i>${text} ${fixed(perMetre, 2)}</li>`).join('')}`;
}

function nearestGait(speed) {
  return GAITS.reduce((best, gait) => (Math.abs(gait.speed - speed) < Math.abs(best.speed - speed) ? gait : best));
}

// -- every frame ------------------------------------------------------------------------------

function frontSamples() {
  const { gait, time, begun } = front;
  const samples = [];
  let foot = null;
  for (let t = Math.max(begun, time - SHOWN - 0.05); t <= time + 1e-9; t += 0.01) {
    const at = gaitAt(gait, t - begun);
    samples.push({ ...at, t, landed: foot !== null && at.foot !== foot });
    foot = at.foot;
  }
  return samples;
}

function drawFront() {
  const { gait, ghost, time, begun } = front;
  const now = gaitAt(gait, time - begun);
  const past = [];
  for (let t = Math.max(0, time - begun - 0.5); t < time - begun; t += 0.0125) past.push(bobOf(gaitAt(gait, t).pose, CONSTANTS));
  const scene = byId('front-scene');
  // The ghost comes round again: off one side and back on the other.
  const lap = 2 * halfView(scene, CONSTANTS) + 2.5 * CONSTANTS.L1;
  const ahead = ghost.shown.x - ghost.start - (now.pose.x - front.origin);
  const shift = now.pose.x - ghost.shown.x + ((((ahead + lap / 2) % lap) + lap) % lap) - lap / 2;
  const moved = (pose) => ({ ...pose, x: pose.x + shift });
  const trail = ghost.samples.slice(-45).map(({ pose }) => bobOf(moved(pose), ghost.p));
  drawScene(scene, [
    { pose: moved(ghost.shown), p: ghost.p, colour: COLOURS.ghost, ghost: true, trail },
    { pose: now.pose, p: CONSTANTS, colour: gaitColour(gait), trail: past, glow: now.power / Math.max(gait.peak, 4) },
  ], now.pose.x, DATA.machine.slope);
  drawChart(byId('chart'));
  const samples = frontSamples();
  if (samples.length) drawStrips(byId('front-strips'), samples, DATA.machine.voltage_limit, gait.peak);
  const { speed, cot } = ghost.recent(KEPT);
  byId('ghost-caption').textContent = ghost.time < KEPT ? 'learned policy, starting from rest' : `learned policy: ${fixed(speed, 2)} m/s, cost ${costText(cot)}`;
}

function setUpFront() {
  front.origin = gaitAt(front.gait, 0).pose.x;
  front.ghost.start = front.ghost.shown.x + 0.5 * CONSTANTS.L1;
  const [chart, pause] = [byId('chart'), byId('pause')];
  chart.setAttribute('aria-valuemax', GAITS.length - 1);
  chart.addEventListener('keydown', (event) => {
    const i = GAITS.indexOf(front.gait);
    const last = GAITS.length - 1;
    const wanted = { ArrowLeft: i - 1, ArrowDown: i - 1, ArrowRight: i + 1, ArrowUp: i + 1, Home: 0, End: last }[event.key];
    if (wanted === undefined) return;
    event.preventDefault();
    event.stopPropagation();
    choose(GAITS[clamp(wanted, 0, last)]);
  });
  const drag = (event) => {
    const box = chart.getBoundingClientRect();
    choose(nearestGait(chartScales(box.width, box.height).speed(event.clientX - box.left)));
  };
  chart.addEventListener('pointerdown', (event) => {
    chart.setPointerCapture(event.pointerId);
    drag(event);
  });
  chart.addEventListener('pointermove', (event) => {
    if (event.buttons) drag(event);
  });
  const show = () => {
    pause.textContent = front.playing ? '❚❚' : '▶';
    pause.setAttribute('aria-label', front.playing ? 'Pause' : 'Play');
  };
  pause.addEventListener('click', () => {
    front.playing = !front.playing;
    show();
  });
  show();
  choose(front.gait);
}
