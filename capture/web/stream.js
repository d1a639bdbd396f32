/* The controls of a straight stream: each change goes to the server, which answers with the state. */
"use strict";

const form = document.getElementById("view");
const counts = document.getElementById("counts");
const problem = document.getElementById("problem");

function show(state) {
  for (const [name, value] of Object.entries(state.view)) {
    const field = form.elements[name];
    const text = value === null ? "" : String(value);
    if (document.activeElement === field) continue;
    if (field.options && ![...field.options].some(option => option.value === text))
      field.add(new Option(text, text));
    field.value = text;
  }
  if (state.depth_image)
    document.getElementById("depth-label").textContent = "depth where unknown, m";
  counts.textContent = state.counts;
  if (state.problem) problem.textContent = state.problem;
}

async function ask(path, options) {
  const answer = await fetch(path, options);
  const state = await answer.json();
  if (answer.ok) show(state);
  return state;
}

form.addEventListener("change", async event => {
  const { name, value } = event.target;
  const number = value === "" ? null : Number(value);
  const body = JSON.stringify({ [name]: number });
  const state = await ask("/view", { method: "POST", body });
  problem.textContent = state.error ?? "";
});
form.addEventListener("submit", event => event.preventDefault());

async function poll() {
  try {
    await ask("/state");
  } catch {
    counts.textContent = "The stream has ended.";
  }
  setTimeout(poll, 1000);
}
poll();
