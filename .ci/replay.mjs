// Opens replay.html in a headless browser, uses it by keyboard, pointer and finger, and compares
// what it shows with the CSV files beside it; then checks that it and index.html fit screens and
// are readable, light and dark: node replay.mjs BROWSER FOLDER. Speaks the DevTools protocol over
// a pipe, so that it needs nothing but node.
import assert from "node:assert/strict";
import { spawn } from "node:child_process";
import { mkdtempSync, mkdirSync, readFileSync, rmSync, statSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join, resolve } from "node:path";
import { pathToFileURL } from "node:url";

const [browser, folder] = process.argv.slice(2);
const file = resolve(folder, "replay.html");
const url = pathToFileURL(file).href;
const index = pathToFileURL(resolve(folder, "index.html")).href;
const csv = (name) => {
  const [head, ...lines] = readFileSync(join(folder, name), "utf8").trim().split("\n");
  const names = head.split(",");
  return lines.map((line) => Object.fromEntries(line.split(",").map((v, i) => [names[i], v])));
};
const sleep = (ms) => new Promise((done) => setTimeout(done, ms));

// One file of at most 2 MB, and the accuracies of drives are those of Table 1.
assert.ok(statSync(file).size <= 2e6, "replay.html has more than 2 MB");
const table = csv("table1.csv");
const drives = csv("drives.csv");
for (const { initial, sigma, estimator, runs, mean } of table) {
  const those = drives.filter((d) => d.initial === initial && d.sigma === sigma);
  assert.equal(those.length, Number(runs));
  const sum = those.reduce((total, d) => total + Number(d[estimator]), 0);
  const difference = Math.abs(sum / those.length - Number(mean));
  assert.ok(difference < 1e-6, `drives.csv and table1.csv differ in ${estimator}`);
}

const profile = mkdtempSync(join(tmpdir(), "wayfix-replay-"));
const child = spawn(browser, [
  "--headless", "--remote-debugging-pipe", `--user-data-dir=${profile}`, "--no-sandbox",
  "--disable-gpu", "--disable-dev-shm-usage", "--no-first-run", "--window-size=1200,900",
], { stdio: ["ignore", "ignore", "ignore", "pipe", "pipe"] });
const late = setTimeout(() => {
  console.error("replay: the browser does not answer");
  child.kill("SIGKILL");
}, 300_000);

child.once("exit", () => {
  for (const [, failed] of asked.values()) failed(new Error("the browser has ended"));
});

const problems = [];
const asked = new Map();
let last = 0;
let session;
let text = "";
child.stdio[4].setEncoding("utf8").on("data", (more) => {
  text += more;
  for (let end; (end = text.indexOf("\0")) >= 0; text = text.slice(end + 1)) {
    const { id, result, error, method, params } = JSON.parse(text.slice(0, end));
    if (id) {
      const [done, failed] = asked.get(id);
      if (error) failed(new Error(error.message)); else done(result);
    } else if (method === "Runtime.exceptionThrown") {
      problems.push(params.exceptionDetails.exception?.description ?? params.exceptionDetails.text);
    } else if (method === "Log.entryAdded" && params.entry.level === "error") {
      problems.push(params.entry.text);
    } else if (method === "Runtime.consoleAPICalled" && ["error", "assert"].includes(params.type)) {
      problems.push(JSON.stringify(params.args));
    } else if (method === "Network.requestWillBeSent") {
      const { url: wanted } = params.request;
      // The index shows pictures beside it, the replay is one file.
      const beside = wanted.startsWith(new URL(".", index).href) && params.documentURL === index;
      const own = wanted.startsWith(url) || wanted.startsWith("data:") || beside;
      if (!own) problems.push(`asks for ${wanted}`);
    }
  }
});
const ask = (method, params = {}) => new Promise((done, failed) => {
  asked.set(++last, [done, failed]);
  child.stdio[3].write(`${JSON.stringify({ id: last, method, params, sessionId: session })}\0`);
});
const value = async (expression) => {
  const { result, exceptionDetails } =
    await ask("Runtime.evaluate", { expression, returnByValue: true, awaitPromise: true });
  assert.ok(!exceptionDetails, exceptionDetails?.exception?.description);
  return result.value;
};
const press = async (key, text) => {
  await ask("Input.dispatchKeyEvent", { type: text ? "keyDown" : "rawKeyDown", key, text,
    windowsVirtualKeyCode: { Tab: 9, " ": 32, End: 35, Home: 36, ArrowLeft: 37, ArrowRight: 39 }[key] });
  await ask("Input.dispatchKeyEvent", { type: "keyUp", key });
};
const click = async (selector, across = 0.5) => {
  const [x, y] = await value(`(() => {
    const it = document.querySelector("${selector}");
    it.scrollIntoView({ block: "center" });
    const box = it.getBoundingClientRect();
    return [box.left + ${across} * box.width, box.top + box.height / 2];
  })()`);
  for (const type of ["mousePressed", "mouseReleased"]) {
    await ask("Input.dispatchMouseEvent", { type, x, y, button: "left", clickCount: 1 });
  }
};
const open = async (fragment, page = url) => {
  await ask("Page.navigate", { url: "about:blank" });
  await ask("Page.navigate", { url: page + fragment });
  const arrived = `document.readyState === "complete" && location.href.startsWith(${JSON.stringify(page)})`;
  while (!await value(arrived)) {
    await sleep(20);
  }
};
const size = (width, height, mobile) =>
  ask("Emulation.setDeviceMetricsOverride", { width, height, deviceScaleFactor: mobile ? 2 : 1, mobile });
// What is shown of a step: its name, the words, both tables, and the areas of circles.
const shown = () => value(`(() => {
  const areas = (who) => [...document.querySelectorAll("#" + who + " circle")].map((circle) =>
    (Number(circle.getAttribute("r")) + Number(circle.getAttribute("stroke-width")) / 2) ** 2);
  const top = (who) => [...document.querySelectorAll("#" + who + "-top tbody tr")].map((row) =>
    ({ place: row.cells[0].textContent, p: row.cells[2].textContent, true: row.className === "true" }));
  return {
    step: document.querySelector("#place").textContent,
    says: document.querySelector("#status").textContent,
    badge: !document.querySelector("#badge").hidden,
    playing: document.querySelector("#play").textContent.includes("Pause"),
    truth: document.querySelector("#truth").outerHTML,
    areas: { filter: areas("filter"), smoother: areas("smoother") },
    top: { filter: top("filter"), smoother: top("smoother") },
  };
})()`);
const at = async (step) => {
  const now = await shown();
  assert.match(now.step, new RegExp(`^Step ${step} of`));
  return now;
};

async function keyboardAndPointer() {
  await open("#setting=2&drive=3&step=7");
  const seventh = await at(7);
  await press("ArrowRight");
  const eighth = await at(8);
  assert.notEqual(seventh.says, eighth.says);
  assert.notDeepEqual(seventh.areas, eighth.areas);
  await press("ArrowLeft");
  assert.deepEqual(await at(7), seventh);
  await press("End");
  await at(50);
  await press("ArrowRight");
  await at(50);
  await press("Home");
  await at(1);
  await press(" ", " ");
  assert.ok((await shown()).playing);
  while ((await shown()).step.startsWith("Step 1 ")) await sleep(50);
  await press(" ", " ");
  assert.ok(!(await shown()).playing);
  await click("#strip", 20.5 / 50);
  await at(21);
  await click("#forward");
  await at(22);
  await click("#back");
  await at(21);
  await value("document.querySelector('#step').focus()");
  await press("ArrowRight");
  await at(22);
}

// Every drive: its accuracies, its marks, and at each of its corrections the tables.
async function numbers() {
  const settings = table.filter((row) => row.estimator === "filter");
  for (const [s, { initial, sigma, runs }] of settings.entries()) {
    const count = Math.min(10, Number(runs));
    for (let d = 1; d <= count; d++) {
      await value(`new Promise((done) => {
        addEventListener("hashchange", () => done(), { once: true });
        location.hash = "setting=${s + 1}&drive=${d}&step=50";
      })`);
      const expected = drives.find((row) =>
        row.initial === initial && row.sigma === sigma && row.drive === String(d));
      const page = await value(`({
        setting: document.querySelector("#setting").selectedOptions[0].textContent,
        drives: [...document.querySelector("#drive").options].map((option) => option.textContent),
        filter: document.querySelector("#filter-accuracy").textContent,
        smoother: document.querySelector("#smoother-accuracy").textContent,
        corrections: document.querySelector("#corrections").textContent,
        marks: [...document.querySelector("#strip").children].map((it) => it.className.includes("correction")),
      })`);
      const { filter, smoother } = expected;
      assert.equal(page.setting, `start ${initial}, σ = ${sigma}`);
      assert.deepEqual([page.filter, page.smoother], [filter, smoother]);
      assert.equal(page.drives.length, count);
      assert.equal(page.drives[d - 1], `${d}: filter ${filter}, smoother ${smoother}`);

      const [corrected, spoiled] = page.corrections.match(/\d+/g).map(Number);
      assert.equal(Math.round(50 * (smoother - filter)), corrected - spoiled);
      const marked = page.marks.flatMap((mark, k) => (mark ? [k + 1] : []));
      assert.equal(marked.length, corrected);
      for (const step of marked) {
        await value("document.querySelector('#next').click()");
        const { badge, top, areas } = await at(step);
        assert.ok(badge && !top.filter[0].true && top.smoother[0].true);
        for (const who of ["filter", "smoother"]) {
          const [{ place, p }] = top[who];
          const total = areas[who].reduce((sum, area) => sum + area, 0);
          const part = areas[who][place - 1] / total;
          // What is less than 0.001 has no circle, unless it is among the first five.
          assert.ok(Math.abs(part - p) < 0.02, `${who}: ${p} has ${part} of the area`);
        }
      }
    }
  }
}

async function accessible() {
  await open("");
  const { nodes } = await ask("Accessibility.getFullAXTree");
  const roles = ["button", "combobox", "slider", "image", "table", "link"];
  const controls = nodes.filter((node) => !node.ignored && roles.includes(node.role?.value));
  for (const role of roles) assert.ok(controls.some((node) => node.role.value === role), role);
  for (const node of controls) assert.ok(node.name?.value, `a ${node.role.value} has no name`);

  const reached = [];
  for (let i = 0; i < 12; i++) {
    await press("Tab");
    reached.push(...await value(`(() => {
      const it = document.activeElement;
      return it.id && getComputedStyle(it).outlineStyle !== "none" ? [it.id] : [];
    })()`));
  }
  const wanted = ["setting", "drive", "step", "back", "play", "forward", "next"];
  assert.deepEqual(wanted.filter((id) => !reached.includes(id)), [], "not reached by Tab");
  await value("document.querySelector('#drive').focus()");
  await press("ArrowRight");
  assert.equal(await value("document.querySelector('#drive').value"), "2");

  await size(390, 844, true);
  await open("");
  const phone = await value(`({
    width: document.documentElement.scrollWidth,
    small: [...document.querySelectorAll("button, select, input")].filter((it) => {
      const { width, height } = it.getBoundingClientRect();
      return width < 44 || height < 44;
    }).map((it) => it.id),
  })`);
  assert.ok(phone.width <= 390, `${phone.width} pixels wide on a phone of 390`);
  assert.deepEqual(phone.small, [], "too small to touch");

  // A finger on the slider's thumb, from the first step to the middle.
  const [left, width, y] = await value(`(() => {
    const it = document.querySelector("#step");
    it.scrollIntoView({ block: "center" });
    const box = it.getBoundingClientRect();
    return [box.left, box.width, box.top + box.height / 2];
  })()`);
  assert.ok(width >= 0.9 * 390, `the slider has ${width} of 390 pixels`);
  await ask("Emulation.setTouchEmulationEnabled", { enabled: true });
  for (const [type, part] of [["touchStart", 0], ["touchMove", 0.2], ["touchMove", 0.5], ["touchEnd"]]) {
    const x = left + 20 + part * (width - 40);
    await ask("Input.dispatchTouchEvent", { type, touchPoints: part === undefined ? [] : [{ x, y }] });
  }
  // A finger that misses the slider may leave the page.
  const dragged = Number(await value("document.querySelector('#step')?.value"));
  assert.ok(Math.abs(dragged - 25) <= 2, `dragged to step ${dragged}, not to the middle`);
  await ask("Emulation.setTouchEmulationEnabled", { enabled: false });
}

// On screens of a phone and a desk, light and dark: nothing wider than the screen, text that
// stands out from its ground, and numbers of places that are apart from each other.
async function screens() {
  for (const width of [390, 1280]) {
    await size(width, width < 600 ? 844 : 900, width < 600);
    for (const scheme of ["light", "dark"]) {
      const features = [{ name: "prefers-color-scheme", value: scheme }];
      await ask("Emulation.setEmulatedMedia", { features });
      for (const page of [index, url]) {
        const where = `${page.split("/").pop()} at ${width} pixels, ${scheme}`;
        await open("", page);
        const { wide, dim, dark } = await value(`(() => {
          const light = (colour) => {
            const [r, g, b] = colour.match(/[0-9.]+/g).map((part) => part / 255)
              .map((part) => part <= 0.04045 ? part / 12.92 : ((part + 0.055) / 1.055) ** 2.4);
            return 0.2126 * r + 0.7152 * g + 0.0722 * b;
          };
          const ground = (it) => {
            const colour = getComputedStyle(it).backgroundColor;
            return /, 0\\)$/.test(colour) ? ground(it.parentElement) : colour;
          };
          const dim = [...document.querySelectorAll("p, a, td, th, dd, dt, label, button, select, figcaption, h1, h2, li, strong, span")]
            .filter((it) => it.textContent.trim() && it.offsetParent).filter((it) => {
              const [a, b] = [light(getComputedStyle(it).color), light(ground(it))].sort((a, b) => b - a);
              return (a + 0.05) / (b + 0.05) < 4.5;
            }).map((it) => it.outerHTML.slice(0, 80));
          return { wide: document.documentElement.scrollWidth, dim,
            dark: light(ground(document.body)) < 0.2 };
        })()`);
        assert.ok(wide <= width, `${where}: ${wide} pixels wide`);
        assert.deepEqual(dim, [], `${where}: too little contrast`);
        assert.equal(dark, scheme === "dark", where);
      }
    }
    await open("");
    await value("document.head.append(Object.assign(document.createElement('style'), { textContent: '* { transition: none !important }' }))");
    const overlaps = await value(`(() => {
      const found = new Set();
      const choose = (id, i) => {
        document.querySelector(id).selectedIndex = i;
        document.querySelector(id).onchange();
      };
      for (let s = 0; s < document.querySelector("#setting").length; s++) {
        choose("#setting", s);
        for (let d = 0; d < document.querySelector("#drive").length; d++) {
          choose("#drive", d);
          for (let step = 1; step <= 50; step++) {
            const slider = document.querySelector("#step");
            slider.value = step;
            slider.oninput();
            const texts = [...document.querySelectorAll("#numbers text")].filter((it) =>
              it.getBoundingClientRect().width > 0 && getComputedStyle(it).visibility === "visible");
            const boxes = texts.map((it) => [it.textContent, it.getBoundingClientRect()]);
            const map = document.querySelector("#map").getBoundingClientRect();
            for (const [i, [name, a]] of boxes.entries()) {
              if (a.left < map.left || a.right > map.right || a.top < map.top || a.bottom > map.bottom) {
                found.add(name + " is cut");
              }
              for (const [other, b] of boxes.slice(0, i)) {
                if (a.left < b.right && b.left < a.right && a.top < b.bottom && b.top < a.bottom) {
                  found.add(name + " and " + other);
                }
              }
            }
          }
        }
      }
      return [...found];
    })()`);
    assert.deepEqual(overlaps, [], `numbers of places at ${width} pixels overlap`);
  }
}

async function screenshots(into) {
  mkdirSync(into, { recursive: true });
  for (const width of [390, 1280]) {
    await size(width, width < 600 ? 844 : 900, width < 600);
    for (const scheme of ["light", "dark"]) {
      const features = [{ name: "prefers-color-scheme", value: scheme }];
      await ask("Emulation.setEmulatedMedia", { features });
      for (const [page, fragment] of [
        [index, ""], [url, "#setting=1&drive=1&step=1"], [url, "#setting=2&drive=3&step=16"],
        [url, "#setting=3&drive=7&step=40"],
      ]) {
        await open(fragment, page);
        await sleep(400);
        const { data } = await ask("Page.captureScreenshot", { captureBeyondViewport: true });
        const name = page === index ? "index" : fragment.match(/\d+/g).join("-");
        writeFileSync(join(into, `${name}-${width}-${scheme}.png`), data, "base64");
      }
    }
  }
}

try {
  const { targetId } = await ask("Target.createTarget", { url: "about:blank" });
  session = (await ask("Target.attachToTarget", { targetId, flatten: true })).sessionId;
  for (const domain of ["Page", "Runtime", "Log", "Network", "Accessibility"]) {
    await ask(`${domain}.enable`);
  }
  await keyboardAndPointer();
  await numbers();
  await accessible();
  await screens();
  if (process.env.WAYFIX_SCREENSHOTS) await screenshots(process.env.WAYFIX_SCREENSHOTS);
  assert.deepEqual(problems, [], "errors on the page");
  console.log("replay: plays, and says what the tables say");
} finally {
  clearTimeout(late);
  const ended = child.exitCode ?? child.signalCode
    ?? new Promise((done) => child.once("exit", done));
  child.kill();
  await ended;
  rmSync(profile, { recursive: true, force: true, maxRetries: 5, retryDelay: 100 });
}
