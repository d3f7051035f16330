// Pace of drawing: soon after a request, but not before the previous picture is done, with fewer pixels while that takes long.

const SLOW_MS = 40;
const STILL_MS = 400;

export class Pacing {
  // `draw`: called with the resolution, at most 1.
  constructor(gl, draw) {
    this.gl = gl;
    this.draw = draw;
    this.isRequested = this.isBusy = false;
    this.resolution = 1;
    this.mean_ms = null;
  }

  // Slow drawing takes at most half of the time.
  request() {
    this.isRequested = true;
    clearTimeout(this.sharpening);
    this.sharpening = setTimeout(() => this.sharpen(), STILL_MS);
    if (this.isBusy) return;
    this.isBusy = true;
    requestAnimationFrame(() => this.drawNow());
  }

  drawNow() {
    const { gl } = this, start_ms = performance.now();
    this.isRequested = false;
    this.draw(this.resolution);
    const fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
    const poll = () => {
      if (fence && gl.getSyncParameter(fence, gl.SYNC_STATUS) !== gl.SIGNALED && !gl.isContextLost()) {
        setTimeout(poll, 4);
        return;
      }
      gl.deleteSync(fence);
      const duration_ms = performance.now() - start_ms;
      this.adaptResolution(duration_ms);
      setTimeout(() => this.rest(), duration_ms > SLOW_MS ? duration_ms : 0);
    };
    setTimeout(poll, 0);
  }

  rest() {
    this.isBusy = false;
    if (this.isRequested) this.request();
  }

  // Draw what does not move with all pixels, however long that takes.
  sharpen() {
    if (this.isBusy) this.sharpening = setTimeout(() => this.sharpen(), STILL_MS);
    else if (this.resolution < 1) this.draw(1);
  }

  // Fewer pixels while drawing is slow, more again when it is fast.
  adaptResolution(duration_ms) {
    this.mean_ms = 0.8 * (this.mean_ms ?? duration_ms) + 0.2 * duration_ms;
    if (this.mean_ms > 2 * SLOW_MS) this.resolution = Math.max(0.35, this.resolution * Math.max(0.6, Math.sqrt((2 * SLOW_MS) / this.mean_ms)));
    else if (this.mean_ms < SLOW_MS / 2) this.resolution = Math.min(1, this.resolution * 1.02);
  }
}
