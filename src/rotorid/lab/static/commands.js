// Command lines: what a button would run, to copy into a terminal.
import { make, post, say, shellWords, tried } from "./page.js";

const shown = new Set();

/** Words as code, with a button that copies them. */
export function copyable(words, what) {
  const code = make("code", shellWords(words), { tabindex: "0", role: "group", "aria-label": `command line of ${what}` });
  const copy = make("button", "Copy", { class: "plain", "aria-label": `copy the command line of ${what}`, onclick: tried(async () => {
    // Only pages from this machine, or over an encrypted connection, may write to the clipboard.
    if (!navigator.clipboard) { getSelection().selectAllChildren(code); say("The browser does not allow copying here. The command is selected: press Ctrl+C."); return; }
    await navigator.clipboard.writeText(code.textContent);
    say("Copied.");
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

  /** Ask the server again; a refusal is shown as a sentence, which cannot be copied. */
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

  /** Update all visible command lines: a step that was started changes the numbers of later ones. */
  static showAll() {
    for (const line of shown) {
      if (!line.place.isConnected) shown.delete(line);
      else if (line.place.checkVisibility()) line.show();
    }
  }
}
