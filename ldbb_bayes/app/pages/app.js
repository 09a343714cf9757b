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

const post = (path, record) => ask("POST", path, JSON.stringify(record ?? {}), "application/json");

// Puts a step in its place; the element that has the focus keeps it where it is there again.
async function show(name) {
  const place = at(`${name}-section`), focused = document.activeElement?.id;
  const opened = [...place.querySelectorAll("details[open] > summary")].map((summary) => summary.textContent);
  place.classList.add("busy");
  place.inert = true;  // what would be typed now would be lost
  try {
    const answer = await ask("GET", `section/${name}`);
    if (answer.ok) {
      const text = await answer.text(), chooser = place.querySelector("input[type=file]");
      place.innerHTML = text;
      if (chooser) at(chooser.id).replaceWith(chooser);  // files chosen while this is drawn anew must arrive
      for (const summary of place.querySelectorAll("summary")) summary.parentElement.open ||= opened.includes(summary.textContent);
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
  for (const effect of at("worth-section").querySelectorAll("template")) {
    const place = document.querySelector(`.effect[data-part="${effect.dataset.effect}"]`);
    if (place) place.textContent = effect.content.textContent;
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
  const before = state;
  state = await (await ask("GET", `state?${tab}`)).json();
  const changed = state.edition !== before.edition, finished = before.running && !state.running;
  if (changed) await show("files");
  if (changed || state.running !== before.running) await show("fit");
  if (state.running) drawProgress("bar", "step", state.progress);
  if (finished || changed) await show("sheets");
  if (finished || state.fitted !== before.fitted) await show("plan");
  else if (state.searching !== before.searching) await showSearch();
  if (state.searching) drawProgress("search-bar", "search-step", state.search_progress);
  if (finished) {
    tell(state.outcome.state ? words.ready : "");
    if (document.activeElement === document.body) (at("fit-section").querySelector("[role=alert]") ?? at("start"))?.focus();
  }
  if (changed) understanding = understanding.then(understand, understand);
}

// What was typed into the form is sent before anything is fitted or drawn anew.
async function sendEntries() {
  const form = at("form");
  if (!typed || !form) return;
  typed = false;
  await post("entries", Object.fromEntries(new FormData(form)));
}

async function understand() {
  at("worth-section").innerHTML = "";
  if (!state.files) { blocked = false; at("understood-section").innerHTML = ""; return; }
  tell(words.working);
  await show("understood");
  const refused = at("understood-section").querySelector("[role=alert]");
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
  if (!at("cheapest-section")) return;
  await show("cheapest");
  tell(state.searching ? words.working : words.ready);
  if (document.activeElement !== document.body) return;
  const place = at("cheapest-section");
  (place.querySelector("[role=alert]") ?? at("cheapest-campaigns") ?? at("stop") ?? at("search"))?.focus();
}

// What was typed as goals and costs; of the sliders, what circles cost, and whether the tests already run count.
async function search() {
  const asked = Object.fromEntries(new FormData(at("costs")));
  for (const field of at("sliders").elements) if (field.name.startsWith("goal_") || "cost" in field.dataset) asked[field.name] = field.value;
  asked.augment = at("plan-augment").checked;
  for (const field of document.querySelectorAll(".goals [aria-invalid]")) {
    field.removeAttribute("aria-invalid");
    field.removeAttribute("aria-describedby");
  }
  markGoals();
  tell(words.working);
  const answer = await post("search", asked);
  if (!answer.ok) return tell(await reason(answer));
  const outcome = await answer.json();
  if (outcome.refused) await showRefusedSearch(outcome.wrong);
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
  at("cheapest-section").querySelector("[role=alert]")?.focus();
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
  await sendEntries();
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
  const entries = [...items].map((item) => item.webkitGetAsEntry?.()).filter(Boolean), files = [];
  while (entries.length && files.length < Number(words.mostFiles)) {
    const entry = entries.shift();
    if (entry.isFile) files.push(await new Promise((done, fail) => entry.file(done, fail)));
    else {
      const reader = entry.createReader();
      for (let batch = [null]; batch.length;) entries.push(...(batch = await new Promise((done, fail) => reader.readEntries(done, fail))));
    }
  }
  return files.filter((file) => !file.name.startsWith("."));
}

// While sliders move the plan is drawn from few states of the machine, from all once they rest; again where they have moved on.
async function plan(best, fine) {
  const form = at("sliders"), asked = { best, fine };
  chosen = best;
  clearTimeout(resting);
  if (!fine) resting = setTimeout(() => plan(best, true), RESTING_MS);
  for (const field of form.elements) {
    if (field.type === "range") asked[field.name] = Number(field.value);
    else if (field.type === "checkbox") asked[field.name] = field.checked;
    else if (field.name) asked[field.name] = field.value;
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
      const asked = wanted;
      wanted = null;
      const answer = await post("plan", asked);
      place.innerHTML = await answer.text();
      markGoals();
      if (asked.fine) tell(at("time")?.textContent ?? "");
    }
  } finally {
    place.inert = false;
    if (focused && document.activeElement === document.body) place.querySelector(`a[href="${focused}"]`)?.focus();
  }
}

document.addEventListener("click", async (event) => {
  const control = event.target.closest("button, a[data-field]");
  if (!control) return;
  if (control.dataset.field) {
    event.preventDefault();
    const field = at(`entry-${control.dataset.field}`);
    field.closest("details").open = true;
    field.scrollIntoView({ block: "center" });
    field.focus();
  } else if (control.dataset.remove) {
    await sendEntries();
    await ask("DELETE", `files/${encodeURIComponent(control.dataset.remove)}`);
    await look();
    at("chosen").focus();
  } else if (control.id === "example" || control.id === "cancel" || control.id === "start") {
    if (control.id === "start") await sendEntries();
    tell(words.working);
    await post({ example: "example", cancel: "cancel", start: "fit" }[control.id]);
    await look();
    at({ example: "start", cancel: "start", start: "cancel" }[control.id])?.focus();
  } else if (control.id === "stop") {
    await post("stop");
    await look();
    at("search")?.focus();
  } else if (control.id === "best") {
    control.setAttribute("aria-busy", "true");
    tell(words.working);
    control.disabled = true;
    await plan(true, true);
    control.disabled = false;
    control.focus();
    control.removeAttribute("aria-busy");
  }
});

document.addEventListener("submit", async (event) => {
  event.preventDefault();
  if (event.target.id === "costs" && !state.searching) await search();
  if (event.target.id !== "form") return;
  typed = true;
  await sendEntries();
  await look();
});

document.addEventListener("input", (event) => {
  const field = event.target;
  typed ||= field.form?.id === "form";
  if (field.form?.id !== "sliders") return;
  if (field.type === "range") field.nextElementSibling.value = field.value;
  const low = at("plan-low"), high = at("plan-high");
  if (Number(low.value) > Number(high.value)) {
    const other = field === low ? high : low;
    other.value = field.value;
    other.nextElementSibling.value = other.value;
  }
  plan(chosen && field.type === "text", false);  // goals leave the forces as they are
});

document.addEventListener("change", async (event) => {
  if (event.target.id === "chosen") {
    const files = [...event.target.files];
    event.target.value = "";  // so that the same file, corrected, is a change
    await send(files);
  }
  if (event.target.id === "language") { await sendEntries(); await post("entries", { language: event.target.value }); location.reload(); }
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
  if (typed && form) navigator.sendBeacon("entries", JSON.stringify(Object.fromEntries(new FormData(form))));
  navigator.sendBeacon(`leave?${tab}`, "{}");
});
addEventListener("pageshow", (event) => { if (event.persisted) location.reload(); });

look();
