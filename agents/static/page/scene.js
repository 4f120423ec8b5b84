// The drawing of wheels on a slope.

const COLOURS = {};

function readColours() {
  const style = getComputedStyle(document.documentElement);
  for (const name of ['paper', 'card', 'ink', 'soft', 'line', 'sky', 'ground', 'ground-ink', 'leg',
    'whirl', 'swing', 'pendulum', 'ghost', 'you', 'copper', 'friction', 'collision', 'idle',
    'returned', 'drag']) {
    COLOURS[name] = style.getPropertyValue(`--${name}`).trim();
  }
}
readColours();
matchMedia('(prefers-color-scheme: dark)').addEventListener('change', readColours);

const FONT = getComputedStyle(document.body).fontFamily;

// A canvas's context in CSS pixels, cleared; with its width and height.
function cleared(canvas) {
  const { width, height } = canvas.getBoundingClientRect();
  const ratio = Math.min(window.devicePixelRatio || 1, 3);
  const [w, h] = [Math.round(width * ratio), Math.round(height * ratio)];
  if (canvas.width !== w || canvas.height !== h) [canvas.width, canvas.height] = [w, h];
  const ctx = canvas.getContext('2d');
  ctx.setTransform(ratio, 0, 0, ratio, 0, 0);
  ctx.clearRect(0, 0, width, height);
  ctx.font = `13px ${FONT}`;
  ctx.lineCap = 'round';
  ctx.lineJoin = 'round';
  return { ctx, width, height };
}

// Draw walkers on their ground.
//
// walkers: {pose, p, colour, ghost, trail, glow}; the trail holds places of the bob (m), oldest
// first, and glow in [0, 1] is how hard the motor works. The last walker is in front.
// camera: the place (m) in the middle of the picture. slope: rad, downhill positive.
function drawScene(canvas, walkers, camera, slope) {
  const { ctx, width, height } = cleared(canvas);
  const { L1, reach } = walkers[0].p;
  const scale = Math.min(height / (3.15 * L1), width / (3.6 * L1));
  ctx.translate(width / 2, height * 0.85);
  ctx.rotate(slope);
  const wide = width / scale + 2;
  drawGround(ctx, camera, scale, wide, height);
  const at = (x, y) => [(x - camera) * scale, -y * scale];
  for (const walker of walkers) {
    ctx.globalAlpha = walker.ghost ? 0.5 : 1;
    drawTrail(ctx, walker, at);
    drawWheel(ctx, walker, at, scale);
    drawPendulum(ctx, walker, at, scale, reach);
  }
  ctx.globalAlpha = 1;
}

function drawGround(ctx, camera, scale, wide, height) {
  const [left, right] = [-wide * scale, wide * scale];
  ctx.fillStyle = COLOURS.ground;
  ctx.fillRect(left, 0, right - left, height);
  ctx.fillStyle = COLOURS['ground-ink'];
  ctx.textAlign = 'center';
  ctx.textBaseline = 'top';
  const [first, last] = [Math.ceil((camera - wide / 2) * 10), Math.floor((camera + wide / 2) * 10)];
  for (let k = first; k <= last; k++) {
    const x = (k / 10 - camera) * scale;
    const long = k % 5 === 0;
    ctx.fillRect(x - 0.75, 0, 1.5, long ? 10 : 5);
    if (long) ctx.fillText(`${fixed(k / 10, 1)} m`, x, 13);
  }
}

function drawTrail(ctx, { trail, colour, p }, at) {
  if (!trail) return;
  ctx.lineWidth = 2.5;
  ctx.strokeStyle = colour === COLOURS.ghost ? colour : COLOURS.pendulum;
  ctx.lineCap = 'butt';
  const whole = ctx.globalAlpha;
  for (let i = 1; i < trail.length; i++) {
    ctx.globalAlpha = whole * 0.55 * (i / trail.length) ** 1.5;
    ctx.beginPath();
    ctx.moveTo(...at(...trail[i - 1]));
    ctx.lineTo(...at(...trail[i]));
    ctx.stroke();
  }
  ctx.globalAlpha = whole;
  ctx.lineCap = 'round';
}

function drawWheel(ctx, { pose, p, colour, ghost }, at, scale) {
  const [x, y] = at(pose.x, pose.y);
  const legs = Math.round((2 * Math.PI) / p.alpha);
  const place = pose.turned / p.alpha;
  const down = Math.round(place - Math.PI / 2 / p.alpha);
  for (let k = 0; k < legs; k++) {
    // The stance leg points from the hub to its foot at the angle -phi.
    const angle = pose.turned - (down + k) * p.alpha;
    const [fx, fy] = [x + p.L1 * scale * Math.cos(angle), y + p.L1 * scale * Math.sin(angle)];
    const stands = k === 0;
    ctx.strokeStyle = ghost ? colour : COLOURS.leg;
    ctx.lineWidth = Math.max(3, 0.032 * p.L1 * scale);
    ctx.beginPath();
    ctx.moveTo(x, y);
    ctx.lineTo(fx, fy);
    ctx.stroke();
    ctx.fillStyle = stands || ghost ? colour : COLOURS.leg;
    ctx.beginPath();
    ctx.arc(fx, fy, Math.max(stands ? 6 : 4, (stands ? 0.05 : 0.035) * p.L1 * scale), 0, 7);
    ctx.fill();
  }
}

function drawPendulum(ctx, { pose, p, colour, ghost, glow }, at, scale, reach) {
  const [x, y] = at(pose.x, pose.y);
  const [bx, by] = at(...bobOf(pose, p));
  const ink = ghost ? colour : COLOURS.pendulum;
  ctx.strokeStyle = ink;
  ctx.lineWidth = Math.max(4, 0.05 * p.L1 * scale);
  ctx.beginPath();
  ctx.moveTo(x, y);
  ctx.lineTo(bx, by);
  ctx.stroke();
  ctx.fillStyle = ink;
  ctx.beginPath();
  ctx.arc(bx, by, Math.max(9, 1.9 * (reach - p.L2) * scale), 0, 7);
  ctx.fill();
  if (glow > 0.01) {
    ctx.save();
    ctx.globalAlpha *= Math.min(0.75, glow);
    ctx.fillStyle = COLOURS.returned;
    ctx.beginPath();
    ctx.arc(x, y, (0.1 + 0.1 * glow) * p.L1 * scale, 0, 7);
    ctx.fill();
    ctx.restore();
  }
  ctx.fillStyle = ghost ? colour : COLOURS.leg;
  ctx.beginPath();
  ctx.arc(x, y, Math.max(5, 0.06 * p.L1 * scale), 0, 7);
  ctx.fill();
  ctx.fillStyle = COLOURS.sky;
  ctx.beginPath();
  ctx.arc(x, y, Math.max(2, 0.022 * p.L1 * scale), 0, 7);
  ctx.fill();
}

// How far the picture reaches to either side of its middle (m).
function halfView(canvas, p) {
  const { width, height } = canvas.getBoundingClientRect();
  return (0.5 * width) / Math.min(height / (3.15 * p.L1), width / (3.6 * p.L1));
}
