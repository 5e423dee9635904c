// Settings of the controller: what can change while it runs does so at once, the rest at the next start. They live for
// one run: the fields are empty again when it has ended, or the board is another one.

import { byId, fill, make } from "./dom.js";
import { doing } from "./notices.js";

/** name, label, unit as written, its factor to SI, least */
const FIELDS = /** @type {const} */ ([
  ["target_stiffness", "Target stiffness", "N/m", 1, 0],
  ["amplitude", "Amplitude", "µm", 1e-6, 0],
  ["virtual_rotation", "Virtual rotation", "rad/s", 1, null],
  ["dither", "Dither", "m/s²", 1, 0],
]);

export class SettingsForm {
  /** @param {import("./board.js").BoardState} state @param {(changed: Record<string, number>) => Promise<void>} onChange while it runs */
  constructor(state, onChange) {
    this.form = byId("settings-form", HTMLFormElement);
    /** @type {Record<string, number>} as the bench file has them */
    this.declared = {};
    /** @type {Map<string, HTMLInputElement>} */
    this.inputs = new Map();
    /** @type {Record<string, number>} in force; where no loop runs, those that the next start begins with */
    this.now = {};
    const rows = FIELDS.flatMap(([name, label, unit, , least]) => {
      const input = make("input", { id: `set-${name}`, name, type: "number", step: "any", ...(least === null ? {} : { min: String(least) }) });
      this.inputs.set(name, input);
      return [make("label", { for: input.id }, label), make("span", { class: "with-unit" }, input, make("span", {}, unit))];
    });
    this.apply = make("button", { type: "submit", disabled: true }, "Apply now");
    fill(this.form, ...rows, make("div", { class: "buttons" }, this.apply));
    this.running = false;
    // where there is little room they are folded away: what one watches comes first
    const roomy = matchMedia("(min-width: 64rem)");
    const fold = () => (byId("settings", HTMLDetailsElement).open = roomy.matches);
    roomy.addEventListener("change", fold);
    fold();
    this.form.addEventListener("input", () => this.mark());
    this.form.addEventListener("submit", doing(async () => {
      if (!this.running) return;
      const changed = Object.fromEntries(Object.entries(this.values()).filter(([name, value]) => value !== this.now[name]));
      if (Object.keys(changed).length) await onChange(changed);
    }));
    state.listen(({ connected, running, settings, nextSettings }, _, before) => {
      // what was filled in was for one run of one board: another one begins with its bench file
      if ((before.running && !running) || before.connected !== connected) this.clear();
      this.running = running;
      this.now = running ? settings : nextSettings;
      for (const [name, input] of this.inputs) this.suggest(name, input);
      this.mark();
    });
  }

  /** @param {Record<string, number>} declared as the chosen bench file has them */
  declare(declared) {
    this.declared = declared;
    for (const [name, input] of this.inputs) this.suggest(name, input);
  }

  clear() {
    for (const input of this.inputs.values()) input.value = "";
  }

  /** @returns {Record<string, number>} what is filled in, SI units */
  values() {
    return Object.fromEntries(FIELDS.flatMap(([name, , , factor]) => {
      const text = this.inputs.get(name)?.value ?? "";
      return text === "" || !Number.isFinite(Number(text)) ? [] : [[name, Number((Number(text) * factor).toPrecision(12))]];
    }));
  }

  /** @param {string} name @param {HTMLInputElement} input */
  suggest(name, input) {
    const factor = FIELDS.find((field) => field[0] === name)?.[3] ?? 1;
    const value = this.now[name] ?? this.declared[name];
    const text = typeof value === "number" ? String(Number((value / factor).toPrecision(6))) : "";
    if (input.placeholder !== text) input.placeholder = text;
  }

  mark() {
    this.apply.disabled = !this.running || !Object.entries(this.values()).some(([name, value]) => value !== this.now[name]);
  }
}
