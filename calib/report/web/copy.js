// Buttons that copy the commands of a page.

const COPIED_MS = 2000; // how long a button says what it did

/** Add a button to every command, which a browser without scripts shows as text. */
function addCopyButtons() {
  for (const command of document.querySelectorAll(".command > :is(code, pre)")) {
    const button = element("button", "copy", "copy");
    button.type = "button";
    button.title = "copy this command";
    button.setAttribute("aria-live", "polite");
    button.addEventListener("click", async () => {
      button.textContent = await copyText(command) ? "copied" : "selected: press Ctrl+C";
      setTimeout(() => { button.textContent = "copy"; }, COPIED_MS);
    });
    command.after(button);
  }
}

/** Copy an element's text and return true. Where the browser does not allow it, select the text and return false. */
async function copyText(node) {
  try {
    await navigator.clipboard.writeText(node.textContent);
    return true;
  } catch { // no permission, or a page over http
    getSelection().selectAllChildren(node);
    return document.execCommand("copy");
  }
}
