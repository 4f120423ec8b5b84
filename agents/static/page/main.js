// The clock of the page.

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
