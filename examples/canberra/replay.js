// Plays drives. A belief is a list: place, probability, place, probability …,
// the most probable first, in whole units; so its first entry is its mode.

const $ = (id) => document.getElementById(id);
const { units, listed, full, places, settings } = JSON.parse($("data").textContent);
const ESTIMATORS = ["filter", "smoother"];
const PAUSE = 800; // Milliseconds between steps.

// Directions of a number and distances from its place, the preferred first.
const TURNS = [1, 1.4, 1.8].flatMap((far) => [0, 1, 7, 2, 6, 3, 5, 4].map((eighth) => [eighth, far]));

let drive;
let timer = null;
let naming;

const number = (place) => places[place][0];
const steps = () => drive.truth.length;
const step = () => $("step").valueAsNumber - 1; // Counted from 0, as the lists are.
const right = (of, who, k) => of[who][k][0] === of.truth[k];
const rights = (of, who) => of.truth.filter((_, k) => right(of, who, k)).length;
const accuracy = (of, who) => (rights(of, who) / of.truth.length).toFixed(2);
const corrected = (k) => !right(drive, "filter", k) && right(drive, "smoother", k);
const spoiled = (k) => right(drive, "filter", k) && !right(drive, "smoother", k);

function element(name, text, classes) {
  const made = document.createElement(name);
  made.textContent = text ?? "";
  made.className = classes ?? "";
  return made;
}

function choices(select, texts) {
  const chosen = Math.max(0, select.selectedIndex);
  select.replaceChildren(...texts.map((text, i) => new Option(text, i + 1)));
  select.selectedIndex = chosen;
}

/// After another drive is chosen.
function showDrive() {
  const { drives } = settings[$("setting").selectedIndex];
  choices($("drive"), drives.map((of, i) =>
    `${i + 1}: filter ${accuracy(of, "filter")}, smoother ${accuracy(of, "smoother")}`));
  drive = drives[$("drive").selectedIndex];
  for (const who of ESTIMATORS) {
    $(`${who}-accuracy`).textContent = accuracy(drive, who);
    $(`${who}-right`).textContent = `right at ${rights(drive, who)} of ${steps()} steps`;
  }
  const all = [...drive.truth.keys()];
  $("corrections").textContent = `The smoother corrects the filter at ${
    all.filter(corrected).length} steps, and is wrong where the filter is right at ${all.filter(spoiled).length}.`;
  $("strip").replaceChildren(...all.map((k) => {
    const column = element("div", "", corrected(k) ? "correction" : "");
    column.append(element("i"), ...ESTIMATORS.map((who) =>
      element("i", "", `${who} ${right(drive, who, k) ? "right" : "wrong"}`)));
    return column;
  }));
  show();
}

/// After another step is chosen.
function show() {
  const k = step();
  const [truth, seen] = [drive.truth[k], drive.seen[k]];
  const modes = ESTIMATORS.map((who) => drive[who][k][0]);
  const circles = $("places").children;
  const at = (place) => ["cx", "cy"].map((axis) => circles[place].getAttribute(axis));

  for (const who of ESTIMATORS) {
    const belief = drive[who][k];
    const radii = new Array(places.length).fill(0);
    const rows = [];
    for (let i = 0; i < belief.length; i += 2) {
      const [place, p] = [belief[i], belief[i + 1] / units];
      radii[place] = full * Math.sqrt(p);
      if (i < 2 * listed) rows.push(row(place, p, place === truth));
    }
    radii.forEach((radius, place) => {
      // A ring lies within its circle.
      const ring = who === "smoother" ? Math.min(radius, 9) : 0;
      const circle = $(who).children[place];
      circle.setAttribute("r", radius - ring / 2);
      circle.setAttribute("stroke-width", ring);
    });
    while (rows.length < listed) rows.push(row());
    $(`${who}-top`).tBodies[0].replaceChildren(...rows);
  }

  $("trail").setAttribute("points",
    [drive.initial, ...drive.truth.slice(0, k + 1)].map(at).join(" "));
  const [x, y] = at(truth);
  $("truth").setAttribute("cx", x);
  $("truth").setAttribute("cy", y);
  for (const id of ["halo", "sighting"]) {
    $(id).setAttribute("d", `M${at(seen)}m0-36l36 36l-36 36l-36-36z`);
  }
  label([truth, ...modes, seen]);
  [...$("strip").children].forEach((column, i) =>
    column.classList.toggle("now-here", i === k));

  const says = ESTIMATORS.map((who, i) =>
    `${who} ${number(modes[i])} (${right(drive, who, k) ? "right" : "wrong"})`);
  $("place").textContent = `Step ${k + 1} of ${steps()}`;
  $("badge").hidden = !corrected(k);
  $("status").textContent = `True place ${number(truth)}, sighting ${number(seen)} (${
    seen === truth ? "right" : "wrong"}), ${says.join(", ")}.`;
  $("step").setAttribute("aria-valuetext",
    `Step ${k + 1} of ${steps()}${corrected(k) ? ", the smoother corrects the filter" : ""}`);
  // Browsers refuse an address that changes with every repeat of a held key.
  clearTimeout(naming);
  naming = setTimeout(() => history.replaceState(null, "",
    `#setting=${$("setting").value}&drive=${$("drive").value}&step=${k + 1}`), 300);
}

/// Sets off the numbers of some places, each turned around its place until it is clear of those
/// before it, of the edge and, if possible, of the marks; other numbers give way.
function label(some) {
  for (const text of $("numbers").children) {
    text.classList.remove("named", "covered");
    turn(text, 0);
  }
  const map = $("map").getBoundingClientRect();
  const marks = ["truth", "sighting"].map((id) => $(id).getBoundingClientRect());
  const taken = [];
  for (const place of new Set(some)) {
    const text = $("numbers").children[place];
    text.classList.add("named");
    let best = { cost: Infinity };
    for (const [eighth, far] of TURNS) {
      turn(text, eighth, far);
      const box = text.getBoundingClientRect();
      const cost = 10 * taken.filter((other) => overlap(other, box)).length
        + 10 * (within(map, box) ? 0 : 1) + marks.filter((mark) => overlap(mark, box)).length;
      if (cost < best.cost) best = { cost, eighth, far, box };
      if (cost === 0) break;
    }
    turn(text, best.eighth, best.far);
    taken.push(best.box);
  }
  for (const text of $("numbers").children) {
    if (text.classList.contains("named")) continue;
    const box = text.getBoundingClientRect();
    text.classList.toggle("covered", taken.some((other) => overlap(other, box)));
  }
}

function turn(text, eighth, far = 1) {
  const [x, y] = text.dataset.direction.split(" ").map(Number);
  if (text.classList.contains("named")) far /= Math.hypot(x, y);
  const [cos, sin] = [Math.cos(eighth * Math.PI / 4), Math.sin(eighth * Math.PI / 4)];
  text.style.setProperty("--x", far * (x * cos - y * sin));
  text.style.setProperty("--y", far * (x * sin + y * cos));
}

const within = (whole, part) => whole.left <= part.left && part.right <= whole.right
  && whole.top <= part.top && part.bottom <= whole.bottom;
const overlap = (a, b) =>
  a.left < b.right && b.left < a.right && a.top < b.bottom && b.top < a.bottom;

function row(place, p, isTrue) {
  const made = element("tr", "", isTrue ? "true" : "");
  if (place === undefined) {
    made.append(element("td"), element("td"), element("td"));
    return made;
  }
  const name = element("td", places[place][1], "name");
  name.title = places[place][1];
  name.style.setProperty("--part", `${100 * p}%`);
  made.append(element("td", number(place)), name,
    element("td", p < 0.001 ? "< 0.001" : p.toFixed(3)));
  return made;
}

function goTo(k) {
  $("step").value = k + 1; // The slider keeps it within the drive.
  show();
}

function play(on) {
  clearInterval(timer);
  timer = on ? setInterval(() => (step() + 1 < steps() ? goTo(step() + 1) : play(false)), PAUSE) : null;
  if (on && step() + 1 === steps()) goTo(0);
  $("play").textContent = on ? "❚❚ Pause" : "▶ Play";
  $("status").setAttribute("aria-live", on ? "off" : "polite");
}

/// The next correction after this step, from the start again after the last.
function nextCorrection() {
  const all = [...drive.truth.keys()].filter(corrected);
  if (all.length > 0) goTo(all.find((k) => k > step()) ?? all[0]);
}

/// Setting, drive and step named by the address: #setting=1&drive=3&step=7, each counted from 1.
function follow(address) {
  const wanted = new URLSearchParams(new URL(address).hash.slice(1));
  const choose = (id, count) => {
    const index = Number(wanted.get(id) ?? 1) - 1;
    $(id).selectedIndex = index >= 0 && index < count ? index : 0;
  };
  choose("setting", settings.length);
  choices($("drive"), settings[$("setting").selectedIndex].drives.map(String));
  choose("drive", $("drive").length);
  $("step").value = Number(wanted.get("step")) || 1;
  showDrive();
}

const stop = (then) => (event) => {
  play(false);
  then(event);
};
const actions = {
  ArrowLeft: stop(() => goTo(step() - 1)),
  ArrowRight: stop(() => goTo(step() + 1)),
  Home: stop(() => goTo(0)),
  End: stop(() => goTo(steps() - 1)),
  c: stop(nextCorrection),
  " ": () => play(timer === null),
};
$("back").onclick = actions.ArrowLeft;
$("forward").onclick = actions.ArrowRight;
$("next").onclick = actions.c;
$("play").onclick = actions[" "];
$("step").oninput = stop(show);
$("setting").onchange = $("drive").onchange = stop(() => {
  $("step").value = 1;
  showDrive();
});
const point = stop((event) => {
  const { left, width } = $("strip").getBoundingClientRect();
  goTo(Math.floor(((event.clientX - left) / width) * steps()));
});
$("strip").onpointerdown = (event) => {
  $("strip").setPointerCapture(event.pointerId);
  point(event);
};
$("strip").onpointermove = (event) => { if (event.buttons) point(event); };
document.onkeydown = (event) => {
  const { target, key } = event;
  const own = target.matches("select")
    || (target.matches("button, a") && key === " ")
    || (target.matches("input") && key !== " " && key !== "c");
  if (own || event.ctrlKey || event.altKey || event.metaKey || !(key in actions)) return;
  event.preventDefault();
  actions[key](event);
};
window.onhashchange = stop(({ newURL }) => follow(newURL));

for (const text of $("numbers").children) turn(text, 0);
choices($("setting"), settings.map(({ name }) => name));
follow(location.href);
