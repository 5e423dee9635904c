// Drive effort: how much of the force there is, is used.

import { byId, fill, make, say } from "./dom.js";
import { quantity } from "./numbers.js";

const UNITS = /** @type {Record<string, string>} */ ({ mps2: "m/s²", N: "N", V: "V" });

/** @param {any} drive what the loop says of it */
export function showDrive(drive) {
  const host = byId("drive");
  byId("drive-none").hidden = Boolean(drive) || host.hasChildNodes();
  if (!drive) return;
  if (!host.hasChildNodes()) {
    fill(host, ...["x", "y"].flatMap((axis) => [
      make("span", {}, axis),
      make("meter", { id: `drive-${axis}`, min: 0, max: 1, high: 0.8, optimum: 0, "aria-label": `Drive of ${axis}, greatest of the last second, in parts of full scale` }),
      make("span", { id: `drive-${axis}-text`, class: "n" }),
    ]));
  }
  const unit = UNITS[drive.unit] ?? drive.unit ?? "";
  for (const axis of ["x", "y"]) {
    const peak = drive[`peak_${axis}`] ?? drive[axis]?.peak ?? null;
    const rms = drive[`rms_${axis}`] ?? drive[axis]?.rms ?? null;
    const full = drive.full_scale ?? 1;
    const part = peak === null ? 0 : peak / full;
    byId(`drive-${axis}`, HTMLMeterElement).value = part;
    say(byId(`drive-${axis}-text`), `${quantity(rms, unit, 3)} rms, peak ${(100 * part).toFixed(part < 0.1 ? 1 : 0)} %`);
  }
}
