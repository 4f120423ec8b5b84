// The race: you against the policy, 30 s from rest, on a machine that you may change.

const RACE = 30; // s
const KEY_VOLTS = 5; // of an arrow key; with Shift, and on the lever, up to the limit

const drive = {
  machine: { ...DATA.machine },
  phase: 'ready', // then 'racing', then 'done'
  held: { keys: new Set(), strong: false, lever: null },
  left: RACE,
};

// The voltage that is held (V), or null where nothing is: then the motor coasts.
function heldVoltage() {
  const { keys, strong, lever } = drive.held;
  if (lever !== null) return lever;
  if (keys.size !== 1) return keys.size ? 0 : null;
  const volts = strong ? drive.machine.voltage_limit : KEY_VOLTS;
  return keys.has('ArrowRight') ? volts : -volts;
}

// The voltage at which no current flows.
function coasting({ dphi, dtheta }, p) {
  const limit = drive.machine.voltage_limit;
  return clamp(wheel.motor_voltage(wheel.relative_rate(dphi, dtheta, p), 0, p), -limit, limit);
}

function newRace() {
  const { machine } = drive;
  drive.you = new Walker(machine, (state, p) => heldVoltage() ?? coasting(state, p));
  drive.policy = new Walker(machine, (state, p) => policyVoltage(state, p, machine));
  Object.assign(drive, { phase: 'ready', left: RACE, seenFalls: 0 });
  byId('start').textContent = 'Start';
  byId('share').disabled = true;
  byId('copied').textContent = '';
  say('');
}

function start() {
  newRace();
  drive.phase = 'racing';
  byId('start').textContent = 'Start again';
  say('Go!');
  byId('lever').focus({ preventScroll: true });
}

function finish() {
  drive.phase = 'done';
  byId('share').disabled = false;
  say(verdict());
}

const say = (text) => {
  if (byId('verdict').textContent !== text) byId('verdict').textContent = text;
};

const altered = () => Object.keys(DATA.machine).some((name) => drive.machine[name] !== DATA.machine[name]);

const ofFalls = (falls) => (falls ? `, ${falls} ${falls === 1 ? 'fall' : 'falls'}` : '');

const times = (ratio) => (ratio >= 10 ? ratio.toFixed(0) : ratio.toFixed(1));

// -- scores ----------------------------------------------------------------------------------

function verdict() {
  const { cot } = drive.you.overall;
  const rival = drive.policy.overall.cot;
  if (!Number.isFinite(cot)) return 'No distance, no cost of transport. Pump the pendulum like a swing!';
  if (cot < rival) return `You walked for ${costText(cot)}: cheaper than the policy!`;
  return `You walked for ${costText(cot)}. The policy needed ${times(cot / rival)} times less.`;
}

// The score as text to pass on.
function scoreText() {
  const { you, policy } = drive;
  const { distance, cot, speed } = you.overall;
  const best = altered() ? NaN : optimumAt(speed);
  const against = [
    Number.isFinite(best) ? `${times(cot / best)} times the optimum at my speed (${costText(best)})` : '',
    `${times(cot / policy.overall.cot)} times the learned policy (${costText(policy.overall.cot)})`,
  ].filter(Boolean).join(' and ');
  const head = `I drove a rimless wheel ${fixed(distance, 1)} m in ${RACE} s`;
  const tail = altered() ? ' (machine changed)' : '';
  if (!Number.isFinite(cot)) return `${head}${ofFalls(you.falls)}. The learned policy: ${fixed(policy.overall.distance, 1)} m.${tail}`;
  return `${head} at a cost of transport of ${costText(cot)}${ofFalls(you.falls)}: ${against}.${tail} Can you walk cheaper?`;
}

async function share() {
  const text = scoreText();
  try {
    await navigator.clipboard.writeText(text);
  } catch {
    const area = document.createElement('textarea');
    area.value = text;
    document.body.append(area);
    area.select();
    document.execCommand('copy');
    area.remove();
  }
  byId('copied').textContent = `Copied: “${text}”`;
}

function showRow(id, { distance, speed, energy, cot } = {}) {
  const cells = byId(id).querySelectorAll('td');
  const texts = distance === undefined
    ? ['', Number.isFinite(speed) ? `${fixed(speed, 2)} m/s` : '', '', costText(cot)]
    : [`${fixed(distance, 1)} m`, `${fixed(speed, 2)} m/s`, `${fixed(energy, 0)} J`, costText(cot)];
  texts.forEach((text, i) => {
    if (cells[i].textContent !== text) cells[i].textContent = text;
  });
}

function showScores() {
  const [you, policy] = [drive.you.overall, drive.policy.overall];
  const best = altered() ? NaN : optimumAt(you.speed);
  showRow('you-row', you);
  showRow('policy-row', policy);
  showRow('optimum-row', { speed: Number.isFinite(best) ? you.speed : NaN, cot: best });
  const notes = altered()
    ? 'The optimum is known only for the machine as it was.'
    : 'The optimum, at your speed, is already walking; you and the policy start from rest.';
  const falls = drive.you.falls ? ` You fell: ${drive.you.falls}.` : '';
  byId('note').textContent = notes + falls;
  drawRuler(byId('ruler'), [
    { name: 'optimum', cot: best, colour: COLOURS.whirl, above: false },
    { name: 'policy', cot: policy.cot, colour: COLOURS.ghost, above: false },
    { name: 'you', cot: you.cot, colour: COLOURS.you, above: true },
  ]);
}

// Costs of transport on one logarithmic line.
function drawRuler(canvas, marks) {
  const { ctx, width, height } = cleared(canvas);
  const [low, high, line] = [0.03, 10, height / 2];
  const x = (cot) => 10 + (Math.log(clamp(cot, low, high) / low) / Math.log(high / low)) * (width - 20);
  ctx.strokeStyle = COLOURS.line;
  ctx.lineWidth = 5;
  ctx.beginPath();
  ctx.moveTo(10, line);
  ctx.lineTo(width - 10, line);
  ctx.stroke();
  ctx.textAlign = 'center';
  ctx.fillStyle = COLOURS.soft;
  ctx.textBaseline = 'bottom';
  ctx.font = `12px ${FONT}`;
  for (const cot of [0.1, 1, 10]) ctx.fillText(`${cot}`, Math.min(x(cot), width - 10), height);
  ctx.font = `600 14px ${FONT}`;
  for (const { name, cot, colour, above } of marks.filter((mark) => Number.isFinite(mark.cot) && mark.cot > 0)) {
    const at = x(cot);
    ctx.fillStyle = colour;
    ctx.beginPath();
    ctx.arc(at, line, 8, 0, 7);
    ctx.fill();
    ctx.textBaseline = above ? 'bottom' : 'top';
    const half = ctx.measureText(name).width / 2;
    ctx.fillText(name, clamp(at, half + 2, width - half - 2), above ? line - 12 : line + 10);
  }
}

// -- the machine ------------------------------------------------------------------------------

function showMachine() {
  const degrees = (drive.machine.slope * 180) / Math.PI;
  const way = degrees > 0.01 ? ' downhill' : degrees < -0.01 ? ' uphill' : '';
  byId('slope-text').textContent = `${fixed(Math.abs(degrees), 1)}°${way}`;
  byId('gear-text').textContent = `${drive.machine.gear_ratio.toFixed(2)} : 1`;
  byId('losses-text').textContent = `× ${fixed(drive.machine.hub_friction / DATA.machine.hub_friction, 2)}`;
}

function changeMachine() {
  const factor = 2 ** Number(byId('losses').value);
  const { hub_friction, gear_loss, slope } = DATA.machine;
  drive.machine = {
    ...DATA.machine,
    slope: slope + (Number(byId('slope').value) * Math.PI) / 180,
    gear_ratio: Number(byId('gear').value),
    hub_friction: hub_friction * factor,
    gear_loss: gear_loss * factor,
  };
  showMachine();
  newRace();
}

function resetMachine() {
  byId('slope').value = 0;
  byId('gear').value = DATA.machine.gear_ratio;
  byId('losses').value = 0;
  changeMachine();
}

// -- every frame ------------------------------------------------------------------------------

// Before a race, the policy walks alone, to show what it makes of the machine.
function followDrive(seconds) {
  const { you, policy, phase } = drive;
  if (phase === 'ready') policy.follow(seconds);
  if (phase !== 'racing') return;
  const step = Math.min(seconds, drive.left);
  you.follow(step);
  policy.follow(step);
  drive.left -= step;
  if (you.falls > drive.seenFalls) {
    drive.seenFalls = you.falls;
    say('The foot lifted off: you fell. Up again!');
    drive.fellAt = drive.left;
  } else if (drive.fellAt - drive.left > 2) say('');
  if (drive.left <= 1e-9) finish();
}

function drawDrive() {
  const { you, policy, phase, machine } = drive;
  const watched = phase === 'ready' ? policy : you;
  const trail = ({ samples, p }) => samples.slice(-50).map(({ pose }) => bobOf(pose, p));
  const glow = ({ samples }) => samples[samples.length - 1].power / 20;
  const scene = byId('drive-scene');
  drawScene(scene, [
    { pose: policy.shown, p: policy.p, colour: COLOURS.ghost, ghost: true, trail: trail(policy) },
    { pose: you.shown, p: you.p, colour: COLOURS.you, trail: trail(you), glow: glow(you) },
  ], watched.shown.x, machine.slope);
  const { width, height } = scene.getBoundingClientRect();
  drawAway(scene.getContext('2d'), width, height, policy.shown.x - you.shown.x, halfView(scene, you.p), phase === 'ready');
  drawStrips(byId('drive-strips'), watched.samples, machine.voltage_limit, 12);
  byId('whose').textContent = phase === 'ready' ? "The policy's" : 'Your';
  byId('clock').textContent = `${fixed(Math.max(drive.left, 0), 1)} s`;
  if (phase === 'ready') {
    const { speed, cot } = policy.recent(KEPT);
    say(policy.time < KEPT ? 'The policy tries your machine …' : `The policy on this machine: ${fixed(speed, 2)} m/s, cost ${costText(cot)}${ofFalls(policy.falls)}`);
  }
  showScores();
  showLever();
}

// Who is out of the picture, and how far.
function drawAway(ctx, width, height, ahead, half, policyInMiddle) {
  const away = policyInMiddle ? -ahead : ahead;
  if (Math.abs(away) < half + 0.2) return;
  const ratio = ctx.canvas.width / width;
  ctx.setTransform(ratio, 0, 0, ratio, 0, 0);
  ctx.font = `600 14px ${FONT}`;
  ctx.fillStyle = policyInMiddle ? COLOURS.you : COLOURS.ghost;
  ctx.textBaseline = 'middle';
  ctx.textAlign = away > 0 ? 'right' : 'left';
  const text = `${policyInMiddle ? 'you' : 'policy'} ${fixed(Math.abs(away), 1)} m`;
  ctx.fillText(away > 0 ? `${text} ▶` : `◀ ${text}`, away > 0 ? width - 14 : 14, height * 0.5);
}

function showLever() {
  const limit = drive.machine.voltage_limit;
  const volts = heldVoltage();
  const lever = byId('lever');
  const across = (v) => 50 + (50 * clamp(v, -limit, limit)) / limit;
  const shown = volts ?? 0;
  const [low, high] = [across(Math.min(shown, 0)), across(Math.max(shown, 0))];
  Object.assign(lever.querySelector('.fill').style, { left: `${low}%`, width: `${high - low}%` });
  lever.querySelector('.emf').style.left = `${across(coasting(drive.you.state, drive.you.p))}%`;
  const text = volts === null ? 'hold here, left or right' : `${fixed(volts, 1)} V`;
  lever.querySelector('.text').textContent = drive.phase === 'racing' && volts === null ? 'coasting' : text;
  lever.setAttribute('aria-valuenow', shown.toFixed(1));
}

// -- hands -----------------------------------------------------------------------------------

function setUpDrive() {
  const [lever, gear] = [byId('lever'), byId('gear')];
  let visible = false;
  new IntersectionObserver(([entry]) => { visible = entry.isIntersecting; }, { threshold: 0.3 })
    .observe(byId('arena'));
  addEventListener('keydown', (event) => {
    drive.held.strong = event.shiftKey;
    const mine = event.key === 'ArrowLeft' || event.key === 'ArrowRight';
    if (!mine || !visible || event.target.matches('input')) return;
    event.preventDefault();
    if (drive.phase === 'ready' && !event.repeat) start();
    drive.held.keys.add(event.key);
  });
  addEventListener('keyup', (event) => {
    drive.held.strong = event.shiftKey;
    drive.held.keys.delete(event.key);
  });
  addEventListener('blur', () => drive.held.keys.clear());
  const pull = (event) => {
    const { left, width } = lever.getBoundingClientRect();
    const limit = drive.machine.voltage_limit;
    drive.held.lever = clamp((2 * (event.clientX - left)) / width - 1, -1, 1) * limit;
  };
  lever.addEventListener('pointerdown', (event) => {
    lever.setPointerCapture(event.pointerId);
    if (drive.phase === 'ready') start();
    pull(event);
  });
  lever.addEventListener('pointermove', (event) => {
    if (drive.held.lever !== null) pull(event);
  });
  for (const end of ['pointerup', 'pointercancel', 'lostpointercapture']) {
    lever.addEventListener(end, () => { drive.held.lever = null; });
  }
  lever.addEventListener('contextmenu', (event) => event.preventDefault());
  byId('start').addEventListener('click', start);
  byId('share').addEventListener('click', share);
  gear.value = DATA.machine.gear_ratio;
  for (const name of ['slope', 'gear', 'losses']) byId(name).addEventListener('input', changeMachine);
  byId('reset').addEventListener('click', resetMachine);
  resetMachine();
}

// -- the clock of the page --------------------------------------------------------------------

const inView = new Set();
const watcher = new IntersectionObserver((entries) => {
  for (const { target, isIntersecting } of entries) inView[isIntersecting ? 'add' : 'delete'](target.id);
});

let lastFrame = null;

function frame(now) {
  const seconds = lastFrame === null ? 0 : clamp((now - lastFrame) / 1000, 0, 0.1);
  lastFrame = now;
  if (front.playing && inView.has('front')) {
    front.time += seconds;
    front.ghost.follow(seconds);
  }
  if (inView.has('front')) drawFront();
  if (drive.phase === 'racing' || (front.playing && inView.has('drive'))) followDrive(seconds);
  if (inView.has('drive')) drawDrive();
  requestAnimationFrame(frame);
}

setUpFront();
setUpDrive();
for (const id of ['front', 'drive']) watcher.observe(byId(id));
requestAnimationFrame(frame);
