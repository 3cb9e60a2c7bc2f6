// ---------------------------------------------------------------- text in time: tabs, the words that are spoken, the prompts

/** Words [text, start, end] in lines that fit the page: a new one after a sentence, a pause, or forty letters or so. */
function linesOf(words) {
  const lines = [];
  let letters = 0;
  words.forEach((word, i) => {
    const before = words[i - 1];
    const fresh = !before || /[.!?…]["”’)]*$/.test(before[0]) || word[1] - before[2] > 0.6 || (letters > 44 && /,$/.test(before[0])) || letters > 70;
    if (fresh) { lines.push([]); letters = 0; }
    lines[lines.length - 1].push(word);
    letters += word[0].length + 1;
  });
  return lines;
}

/** The line below the stage: what is said about now, the word of this moment marked. */
class Spoken {
  constructor(place) { this.place = place; this.lines = []; this.line = -1; this.word = -2; place.hidden = true; }

  choose(words) {
    if (this.words === words) return;
    Object.assign(this, { words, lines: linesOf(words), line: -1, word: -2 });
    this.place.hidden = !words.length;
  }

  show(time) {
    if (!this.lines.length) return;
    const line = Math.max(this.lines.findLastIndex(words => words[0][1] <= time + 0.25), 0), words = this.lines[line];
    const word = words.findLastIndex(one => one[1] <= time);
    if (line === this.line && word === this.word) return;
    if (line !== this.line) {
      this.place.replaceChildren(...words.flatMap(([text]) => [Object.assign(document.createElement("span"), { textContent: text }), " "]));
    }
    [...this.place.children].forEach((span, i) => { span.className = i < word ? "said" : i === word ? "now" : ""; });
    Object.assign(this, { line, word });
  }
}

/** The text of those cues [seconds, text] that holds at a time. */
const cueAt = (cues, time) => cues.findLast(([from]) => from <= time + 1e-3)?.[1] ?? "";

/** Buttons in the header, one for each group of figures; the first is chosen, or the one that the address names (#tab=2). */
function makeTabs(place, groups, choose) {
  place.hidden = groups.length < 2;
  const buttons = groups.map((name, i) => {
    const button = place.appendChild(Object.assign(document.createElement("button"), { type: "button", textContent: name }));
    button.setAttribute("role", "tab");
    button.onclick = () => pick(i);
    button.onkeydown = event => {
      const to = { ArrowLeft: i - 1, ArrowRight: i + 1 }[event.key];
      if (to === undefined) return;
      event.preventDefault(); event.stopPropagation();
      pick((to + groups.length) % groups.length); buttons[(to + groups.length) % groups.length].focus();
    };
    return button;
  });
  function pick(which) {
    buttons.forEach((button, i) => { button.setAttribute("aria-selected", i === which); button.tabIndex = i === which ? 0 : -1; });
    choose(groups[which]);
  }
  const asked = Number(new URLSearchParams(location.hash.slice(1)).get("tab")) || 1;
  return () => pick(Math.min(Math.max(asked, 1), groups.length) - 1);
}
