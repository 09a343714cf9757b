// The page of `ldbb-bayes app`: fetches its steps from the server, sends files and statements, and redraws the plan.
"use strict";

const at = (id) => document.getElementById(id);
const words = document.body.dataset;
const tab = `tab=${crypto.randomUUID()}`;
const SLEEPING_MS = 20000, WORKING_MS = 400, RESTING_MS = 400, READ_MS = 5000, LARGEST = Number(words.mostBytes);
let state = { edition: -1, fitted: -1, running: false, searching: false }, timer = 0, telling = 0, drawing = null, wanted = null, resting = 0, chosen = false, sending = false, looking = Promise.resolve(), understanding = Promise.resolve(), typed = false, blocked = false;

// What is over need not be read for ever.
function tell(text) {
  at("status").textContent = text;
  clearTimeout(telling);
  if (text === words.ready) telling = setTimeout(() => tell(""), READ_MS);
}

async function ask(method, path, body, kind) {
  try {
    const headers = kind ? { "Content-Type": kind } : {};
    const answer = await fetch(path, { method, body, headers, cache: "no-store" });
    if (answer.status === 410) location.reload();
    return answer;
  } catch (error) {
    tell(words.gone);
    throw error;
  }
}

// What a refusal says, whatever came of it.
const reason = async (answer) => (await answer.json().catch(() => ({}))).refused ?? words.gone;

const say = (path, record) => ask("POST", path, JSON.stringify(record ?? {}), "application/json");

// Puts a step in its place; the element that has the focus keeps it where it is there again.
async function show(name) {
  const place = at(`${name}-part`), focused = document.activeElement?.id;
  const opened = [...place.querySelectorAll("details[open] > summary")].map((own) => own.textContent);
  place.classList.add("busy");
  place.inert = true;  // what would be typed now would be lost
  try {
    const answer = await ask("GET", `part/${name}`);
    if (answer.ok) {
      const text = await answer.text(), chooser = place.querySelector("input[type=file]");
      place.innerHTML = text;
      if (chooser) at(chooser.id).replaceWith(chooser);  // files chosen while this is drawn anew must arrive
      for (const own of place.querySelectorAll("summary")) own.parentElement.open ||= opened.includes(own.textContent);
    } else tell(await reason(answer));
  } finally {
    place.classList.remove("busy");
    place.inert = false;
  }
  if (focused && document.activeElement === document.body) at(focused)?.focus();
  if (name === "fit" && at("start")) at("start").disabled = blocked;
  if (name === "plan" || name === "cheapest") lockSearch();
  if (name === "plan") markGoals();
  if (name === "sheets") fitFrame();
  if (name === "worth") placeEffects();
}

function placeEffects() {
  for (const own of at("worth-part").querySelectorAll("template")) {
    const place = document.querySelector(`.effect[data-part="${own.dataset.effect}"]`);
    if (place) place.textContent = own.content.textContent;
  }
}

// As high as the sheets are, so that the page scrolls alone; the annex opens inside.
function fitFrame() {
  const frame = at("report");
  if (!frame) return;
  frame.addEventListener("load", () => {
    const inner = frame.contentDocument, size = () => { frame.style.height = `${inner.body.offsetHeight + 24}px`; };
    size();
    new ResizeObserver(size).observe(inner.body);
  });
}

// One look after the other, none while files are on their way: what is typed meanwhile is not drawn over.
function look() {
  looking = looking.then(lookOnce, lookOnce);
  return looking;
}

async function lookOnce() {
  clearTimeout(timer);
  if (sending) return;
  try {
    await drawChanges();
  } finally {
    timer = setTimeout(look, state.running || state.searching ? WORKING_MS : SLEEPING_MS);
  }
}

async function drawChanges() {
  const found = await (await ask("GET", `state?${tab}`)).json(), before = state;
  state = found;
  const changed = found.edition !== before.edition, finished = before.running && !found.running;
  if (changed) await show("files");
  if (changed || found.running !== before.running) await show("fit");
  if (found.running) drawProgress("bar", "step", found.progress);
  if (finished || changed) await show("sheets");
  if (finished || found.fitted !== before.fitted) await show("plan");
  else if (found.searching !== before.searching) await showSearch();
  if (found.searching) drawProgress("search-bar", "search-step", found.search_progress);
  if (finished) {
    tell(found.outcome.state ? words.ready : "");
    if (document.activeElement === document.body) (at("fit-part").querySelector("[role=alert]") ?? at("start"))?.focus();
  }
  if (changed) understanding = understanding.then(understand, understand);
}

// What was typed into the form is said before anything is fitted or drawn anew.
async function said() {
  const form = at("form");
  if (!typed || !form) return;
  typed = false;
  await say("say", Object.fromEntries(new FormData(form)));
}

async function understand() {
  at("worth-part").innerHTML = "";
  if (!state.files) { blocked = false; at("understood-part").innerHTML = ""; return; }
  tell(words.working);
  await show("understood");
  const refused = at("understood-part").querySelector("[role=alert]");
  blocked = Boolean(refused);
  if (at("start")) at("start").disabled = blocked;
  if (refused) refused.focus();
  else await show("worth");
  tell(refused ? "" : words.ready);
}

// One search at a time: its button waits for it.
function lockSearch() {
  if (at("search")) at("search").disabled = state.searching;
}

// A search has begun or ended; what it says takes the focus where its own button had it.
async function showSearch() {
  if (!at("cheapest-part")) return;
  await show("cheapest");
  tell(state.searching ? words.working : words.ready);
  if (document.activeElement !== document.body) return;
  const place = at("cheapest-part");
  (place.querySelector("[role=alert]") ?? at("cheapest-found") ?? at("stop") ?? at("search"))?.focus();
}

// What was typed as goals and costs; of the sliders, what circles cost, and whether the tests already run count.
async function search() {
  const asked = Object.fromEntries(new FormData(at("costs")));
  for (const own of at("sliders").elements) if (own.name.startsWith("goal_") || "cost" in own.dataset) asked[own.name] = own.value;
  asked.augment = at("plan-augment").checked;
  for (const own of document.querySelectorAll(".goals [aria-invalid]")) {
    own.removeAttribute("aria-invalid");
    own.removeAttribute("aria-describedby");
  }
  markGoals();
  tell(words.working);
  const answer = await say("search", asked);
  if (!answer.ok) return tell(await reason(answer));
  const found = await answer.json();
  if (found.refused) await showRefusedSearch(found.wrong);
  else await look();
}

async function showRefusedSearch(name) {
  await show("cheapest");
  tell("");
  const wrong = name && at(`plan-${name}`);
  if (wrong) {
    wrong.setAttribute("aria-invalid", "true");
    wrong.setAttribute("aria-describedby", "search-why");
  }
  at("cheapest-part").querySelector("[role=alert]")?.focus();
}

// A goal that cannot be read is marked where it was typed; why stands above the table.
function markGoals() {
  for (const field of document.querySelectorAll(".goals input[name^=goal_]")) {
    const why = `why-${field.name}`;
    if (at(why)) {
      field.setAttribute("aria-invalid", "true");
      field.setAttribute("aria-describedby", why);
    } else {
      field.removeAttribute("aria-invalid");
      field.removeAttribute("aria-describedby");
    }
  }
}

function drawProgress(name, nameOfStep, progress) {
  const bar = at(name);
  if (!bar) return;
  bar.value = progress.share;
  const parts = progress.of ? ` ${progress.done}/${progress.of}` : "";
  const time = progress.seconds ? ` (${progress.seconds} s)` : "";  // a long step is seen to go on
  at(nameOfStep).textContent = bar.dataset[progress.step] + parts + time;
}

async function send(files) {
  const refused = [], names = new Set();
  await said();
  sending = true;
  try {
    for (const file of files) {
      if (file.size > LARGEST) {
        refused.push(words.large.replace("{name}", file.name).replace("{most}", String(LARGEST / 2 ** 20)));
      } else if (names.has(file.name)) {
        refused.push(words.twice.replace("{name}", file.name));
      } else {
        names.add(file.name);
        tell(words.sending.replace("{name}", file.name));
        const answer = await ask("PUT", `files/${encodeURIComponent(file.name)}`, file, "application/octet-stream");
        if (!answer.ok) refused.push(await reason(answer));
      }
    }
  } finally {
    sending = false;
    await look();
    await understanding;
    if (refused.length) tell(refused.join(" "));
  }
}

// Files of what was dropped, folders opened.
async function dropped(items) {
  const entries = [...items].map((item) => item.webkitGetAsEntry?.()).filter(Boolean), found = [];
  while (entries.length && found.length < Number(words.mostFiles)) {
    const own = entries.shift();
    if (own.isFile) found.push(await new Promise((done, fail) => own.file(done, fail)));
    else {
      const reader = own.createReader();
      for (let more = [null]; more.length;) entries.push(...(more = await new Promise((done, fail) => reader.readEntries(done, fail))));
    }
  }
  return found.filter((file) => !file.name.startsWith("."));
}

// While sliders move the plan is drawn from few states of the machine, from all once they rest; again where they have moved on.
async function plan(best, fine) {
  const form = at("sliders"), asked = { best, fine };
  chosen = best;
  clearTimeout(resting);
  if (!fine) resting = setTimeout(() => plan(best, true), RESTING_MS);
  for (const own of form.elements) {
    if (own.type === "range") asked[own.name] = Number(own.value);
    else if (own.type === "checkbox") asked[own.name] = own.checked;
    else if (own.name) asked[own.name] = own.value;
  }
  wanted = asked;
  drawing ??= drawPlan().finally(() => { drawing = null; });
  await drawing;
}

async function drawPlan() {
  const place = at("forecast");
  const focused = place.contains(document.activeElement) ? document.activeElement.getAttribute("href") : null;
  place.inert = true;  // its links are of the plan before
  try {
    while (wanted) {
      const own = wanted;
      wanted = null;
      const answer = await say("plan", own);
      place.innerHTML = await answer.text();
      markGoals();
      if (own.fine) tell(at("time")?.textContent ?? "");
    }
  } finally {
    place.inert = false;
    if (focused && document.activeElement === document.body) place.querySelector(`a[href="${focused}"]`)?.focus();
  }
}

document.addEventListener("click", async (event) => {
  const own = event.target.closest("button, a[data-field]");
  if (!own) return;
  if (own.dataset.field) {
    event.preventDefault();
    const field = at(`say-${own.dataset.field}`);
    field.closest("details").open = true;
    field.scrollIntoView({ block: "center" });
    field.focus();
  } else if (own.dataset.remove) {
    await said();
    await ask("DELETE", `files/${encodeURIComponent(own.dataset.remove)}`);
    await look();
    at("chosen").focus();
  } else if (own.id === "example" || own.id === "cancel" || own.id === "start") {
    if (own.id === "start") await said();
    tell(words.working);
    await say({ example: "example", cancel: "cancel", start: "fit" }[own.id]);
    await look();
    at({ example: "start", cancel: "start", start: "cancel" }[own.id])?.focus();
  } else if (own.id === "stop") {
    await say("stop");
    await look();
    at("search")?.focus();
  } else if (own.id === "best") {
    own.setAttribute("aria-busy", "true");
    tell(words.working);
    own.disabled = true;
    await plan(true, true);
    own.disabled = false;
    own.focus();
    own.removeAttribute("aria-busy");
  }
});

document.addEventListener("submit", async (event) => {
  event.preventDefault();
  if (event.target.id === "costs" && !state.searching) await search();
  if (event.target.id !== "form") return;
  typed = true;
  await said();
  await look();
});

document.addEventListener("input", (event) => {
  const own = event.target;
  typed ||= own.form?.id === "form";
  if (own.form?.id !== "sliders") return;
  if (own.type === "range") own.nextElementSibling.value = own.value;
  const low = at("plan-low"), high = at("plan-high");
  if (Number(low.value) > Number(high.value)) {
    const other = own === low ? high : low;
    other.value = own.value;
    other.nextElementSibling.value = other.value;
  }
  plan(chosen && own.type === "text", false);  // goals leave the forces as they are
});

document.addEventListener("change", async (event) => {
  if (event.target.id === "chosen") {
    const files = [...event.target.files];
    event.target.value = "";  // so that the same file, corrected, is a change
    await send(files);
  }
  if (event.target.id === "language") { await said(); await say("say", { language: event.target.value }); location.reload(); }
});

for (const kind of ["dragenter", "dragover", "dragleave", "drop"]) {
  document.addEventListener(kind, async (event) => {
    if (!event.dataTransfer?.types.includes("Files")) return;
    event.preventDefault();
    at("drop")?.classList.toggle("over", kind === "dragenter" || kind === "dragover");
    if (kind === "drop") await send(await dropped(event.dataTransfer.items));
  });
}

// What was typed and not yet applied is there again after a reload.
addEventListener("pagehide", () => {
  const form = at("form");
  if (typed && form) navigator.sendBeacon("say", JSON.stringify(Object.fromEntries(new FormData(form))));
  navigator.sendBeacon(`leave?${tab}`, "{}");
});
addEventListener("pageshow", (event) => { if (event.persisted) location.reload(); });

look();
