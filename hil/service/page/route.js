// Which view is shown: it stands in the address, so that it can be kept, shared and gone back to.

import { byId } from "./dom.js";

/**
 * What the parts of a view share: `show` when it comes into sight, with what follows its name in the address.
 *
 * @typedef {object} View
 * @property {string} title
 * @property {(...path: string[]) => void} [show]
 * @property {() => void} [hide]
 */

/** @param {Record<string, View>} views by name; the first is where one begins */
export function route(views) {
  const first = Object.keys(views)[0];
  /** @type {string | null} */
  let current = null;
  const go = () => {
    const [, name = first, ...path] = location.hash.split("/").map(decodeURIComponent);
    const chosen = name in views ? name : first;
    if (current !== null && current !== chosen) views[current].hide?.();
    for (const other of Object.keys(views)) byId(`view-${other}`).hidden = other !== chosen;
    for (const link of document.querySelectorAll("nav a")) {
      const here = link.getAttribute("href") === `#/${chosen}` || (chosen === "compare" && link.getAttribute("href") === "#/runs");
      if (here) link.setAttribute("aria-current", "page");
      else link.removeAttribute("aria-current");
    }
    document.title = `${views[chosen].title} · gyrohil`;
    if (current !== null && current !== chosen) {
      byId("main").focus({ preventScroll: true });
      scrollTo(0, 0);
    }
    current = chosen;
    views[chosen].show?.(...path);
  };
  addEventListener("hashchange", go);
  go();
}
