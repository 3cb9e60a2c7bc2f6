// ---------------------------------------------------------------- chooses which clip the player shows

const $ = id => document.getElementById(id);
const hole = '<script type="application/json" id="scene">{}</' + "script>";

/** The player's page with one scene inside: the same player, once in the file, for every clip. */
function show(number) {
  const frame = $("player"), parts = JSON.parse($("frame").textContent).split(hole);
  frame.srcdoc = parts.join(hole.replace("{}", () => $(`scene${number}`).textContent));
  $("clip").value = number;
  for (const notes of document.querySelectorAll(".notes")) notes.hidden = notes.dataset.scene !== String(number);
}

if ($("clip")) {
  const count = $("clip").options.length, step = by => show((+$("clip").value + by + count) % count);
  $("clip").onchange = () => show($("clip").value);
  $("before").onclick = () => step(-1);
  $("after").onclick = () => step(1);
  $("before").hidden = $("after").hidden = count < 2;
  show(0);
}
