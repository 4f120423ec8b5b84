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
  Object.assign(drive, { phase: 'ready', left: RACE, seenFalls: 0, messageAt: RACE });
  byId('start').textContent = 'Start';
  byId('share').disabled = true;
  byId('copied').textContent = '';
  showMessage('');
}

function start() {
  newRace();
  drive.phase = 'racing';
  byId('start').textContent = 'Start again';
  showMessage('Go!');
  byId('lever').focus({ preventScroll: true });
}

function finish() {
  drive.phase = 'done';
  byId('share').disabled = false;
  showMessage(result());
}

const showMessage = (text) => {
  if (byId('message').textContent !== text) byId('message').textContent = text;
};

const altered = () => Object.keys(DATA.machine).some((name) => drive.machine[name] !== DATA.machine[name]);

const ofFalls = (falls) => (falls ? `, ${falls} ${falls === 1 ? 'fall' : 'falls'}` : '');

const times = (ratio) => (ratio >= 10 ? ratio.toFixed(0) : ratio.toFixed(1));

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
    showMessage('The foot lifted off: you fell. Up again!');
    drive.messageAt = drive.left;
  } else if (drive.messageAt - drive.left > 2) showMessage('');
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
  byId('message').setAttribute('aria-live', phase === 'ready' ? 'off' : 'polite');
  byId('whose').textContent = phase === 'ready' ? "The policy's" : 'Your';
  byId('clock').textContent = `${fixed(Math.max(drive.left, 0), 1)} s`;
  if (phase === 'ready') {
    const { speed, cot } = policy.recent(KEPT);
    showMessage(policy.time < KEPT ? 'The policy tries your machine …' : `The policy on this machine: ${fixed(speed, 2)} m/s, cost ${costText(cot)}${ofFalls(policy.falls)}`);
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
    .observe(byId('race'));
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
