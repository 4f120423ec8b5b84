// Scores: yours, the policy's and the optimum's, and your score as text to pass on.

function result() {
  const { cot, distance } = drive.you.overall;
  const rival = drive.policy.overall;
  if (distance < -0.05) return `${fixed(-distance, 1)} m backward. Turn the pendulum the other way: to the right counts.`;
  if (!Number.isFinite(cot)) return 'No distance yet. Follow the violet mark, or pump the pendulum like a swing!';
  const way = `${fixed(distance, 1)} m, ${fixed((100 * distance) / rival.distance, 0)} % of the policy's way, at a cost of ${costText(cot)}`;
  if (cot < rival.cot && !drive.you.falls) return `${way}: cheaper than the policy!`;
  return `${way}. The policy needed ${times(cot / rival.cot)} times less.`;
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
  const head = `I drove a rimless wheel ${fixed(distance, 1)} m in ${drive.level.race} s${drive.level === LEVELS.rest ? ' from rest' : ''}`;
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
    : `The optimum, at your speed, is already walking; you and the policy ${drive.level === LEVELS.rest ? 'start from rest' : 'take over a wheel that walks'}.`;
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
