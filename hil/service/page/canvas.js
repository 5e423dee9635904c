// A canvas in pixels of the screen, whatever its size on the page.

/** @type {WeakMap<Element, { width: number, height: number }>} */
const sizes = new WeakMap();
const watcher = new ResizeObserver((entries) => entries.forEach(({ target }) => measure(target)));

/** @param {Element} element */
function measure(element) {
  const size = { width: element.clientWidth, height: element.clientHeight };
  sizes.set(element, size);
  return size;
}

/**
 * In CSS pixels, as of the last time it changed: to ask for it while something else is being written has the browser lay
 * out the page each time.
 *
 * @param {Element} element
 */
export function sizeOf(element) {
  const known = sizes.get(element);
  if (known) return known;
  watcher.observe(element);
  return measure(element);
}

/**
 * @param {HTMLCanvasElement} canvas
 * @returns {{ ink: CanvasRenderingContext2D, width: number, height: number } | null} cleared; in CSS pixels; null out of sight
 */
export function cleared(canvas) {
  const { width, height } = sizeOf(canvas);
  const ink = canvas.getContext("2d");
  if (!ink || width === 0 || height === 0) return null;
  const [across, down] = [Math.round(width * devicePixelRatio), Math.round(height * devicePixelRatio)];
  if (canvas.width !== across || canvas.height !== down) [canvas.width, canvas.height] = [across, down];
  ink.setTransform(devicePixelRatio, 0, 0, devicePixelRatio, 0, 0);
  ink.clearRect(0, 0, width, height);
  return { ink, width, height };
}
