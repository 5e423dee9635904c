// A canvas in pixels of the screen, whatever its size on the page.

/**
 * @param {HTMLCanvasElement} canvas
 * @returns {{ ink: CanvasRenderingContext2D, width: number, height: number } | null} cleared; in CSS pixels; null out of sight
 */
export function cleared(canvas) {
  const { clientWidth: width, clientHeight: height } = canvas;
  const ink = canvas.getContext("2d");
  if (!ink || width === 0 || height === 0) return null;
  const [across, down] = [Math.round(width * devicePixelRatio), Math.round(height * devicePixelRatio)];
  if (canvas.width !== across || canvas.height !== down) [canvas.width, canvas.height] = [across, down];
  ink.setTransform(devicePixelRatio, 0, 0, devicePixelRatio, 0, 0);
  ink.clearRect(0, 0, width, height);
  return { ink, width, height };
}
