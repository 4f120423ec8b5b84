// The learned policy: what it observes, and its network.

const LAYERS = DATA.network.map(({ outputs, weights, biases }) => ({
  outputs, weights: unpacked(weights), biases: unpacked(biases),
}));

// The voltage (V) that the policy holds for the next 10 ms.
function policyVoltage(state, p, machine) {
  const { phi, theta, dphi, dtheta, mode } = state;
  let values = wheel.observation(phi, theta, dphi, dtheta, mode, 2 / p.alpha).map(Math.fround);
  LAYERS.forEach(({ outputs, weights, biases }, depth) => {
    const inputs = values;
    values = Array.from({ length: outputs }, (_, i) => {
      let sum = biases[i];
      for (let j = 0; j < inputs.length; j++) sum += weights[i * inputs.length + j] * inputs[j];
      return depth < LAYERS.length - 1 ? Math.tanh(sum) : sum;
    });
  });
  return machine.voltage_limit * Math.fround(clamp(values[0], -1, 1));
}
