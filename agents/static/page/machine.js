// The machine that you may change.

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
