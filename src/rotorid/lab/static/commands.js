// Command lines: what a button would run, as it is typed at a terminal, to copy.
import { make, post, say, shellWords, tried } from "./page.js";

const shown = new Set();

/** Words as code, with a button that copies them. */
export function copyable(words, what) {
  const code = make("code", shellWords(words), { tabindex: "0", role: "group", "aria-label": `command line of ${what}` });
  const copy = make("button", "Copy", { class: "plain", "aria-label": `copy the command line of ${what}`, onclick: tried(async () => {
    // Only pages from this machine, or over an encrypted connection, may write to the clipboard.
    if (!navigator.clipboard) { getSelection().selectAllChildren(code); say("This page may not copy: the command is selected, press Ctrl+C."); return; }
    await navigator.clipboard.writeText(code.textContent);
    say("The command is copied.");
  }) });
  return { code, copy, place: make("div", "", { class: "command" }, code, copy) };
}

/** The command line of a step that is not started. `stepOf()` gives the step at any moment. */
export class CommandLine {
  constructor(what, stepOf) {
    this.stepOf = stepOf;
    this.asked = 0;
    Object.assign(this, copyable([], what));
    shown.add(this);
  }

  /** Ask the server anew; what it refuses stands there as a sentence, and cannot be copied. */
  async show() {
    const asked = (this.asked += 1);
    this.copy.disabled = true;
    let text, bad = false;
    try {
      text = shellWords((await post("/api/preview", this.stepOf())).command);
    } catch (error) {
      [text, bad] = [error.message, true];
    }
    if (asked !== this.asked) return;
    this.code.textContent = text;
    this.code.className = bad ? "bad" : "";
    this.copy.disabled = bad;
  }

  /** All that can be seen, anew: a step that was started moves the numbers of those to come. */
  static showAll() {
    for (const one of shown) {
      if (!one.place.isConnected) shown.delete(one);
      else if (one.place.checkVisibility()) one.show();
    }
  }
}
