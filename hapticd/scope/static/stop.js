// Stop and e-stop: the first script of the page, on its own. It needs nothing that is loaded after it, neither the stream
// nor the rest of the page, and asks nobody for confirmation.
// @ts-check
"use strict";
(() => {
  const TRIES = 5;
  const RETRY_MS = 200;
  const TWICE_MS = 1000;
  let escapedAt = -Infinity;
  let asked = 0; // what was asked last is answered last, whichever reply is late

  /** @param {number} number @param {string} text @param {boolean} bad */
  function say(number, text, bad) {
    const place = document.getElementById("stop-answer");
    if (place && number === asked) {
      place.textContent = text;
      place.classList.toggle("bad", bad);
    }
  }

  /** @param {"stop" | "estop"} name @param {number} number @param {number} tries */
  async function send(name, number = ++asked, tries = TRIES) {
    const label = name === "stop" ? "Stop" : "E-stop";
    say(number, `${label} sent …`, false);
    try {
      const reply = await fetch(`/api/${name}`, {
        method: "POST",
        headers: { Authorization: `Bearer ${location.hash.slice(1)}`, "Content-Type": "application/json" },
        body: "{}",
        keepalive: true,
      });
      const answer = await reply.json();
      if (reply.ok) {
        say(number, `${label}: ${answer.unanswered ?? `the daemon says ${answer.state}`}`, false);
      } else {
        say(number, `${label} REFUSED: ${answer.error.message}`, true);
      }
    } catch (error) {
      if (tries > 1) {
        setTimeout(() => send(name, number, tries - 1), RETRY_MS);
      } else {
        say(number, `${label} NOT SENT: the server does not answer. Cut the power of the amplifier.`, true);
      }
    }
  }

  document.getElementById("stop")?.addEventListener("click", () => send("stop"));
  document.getElementById("estop")?.addEventListener("click", () => send("estop"));
  window.addEventListener(
    "keydown",
    (event) => {
      if (event.key !== "Escape" || event.repeat) return;
      const twice = event.timeStamp - escapedAt < TWICE_MS;
      escapedAt = event.timeStamp;
      send(twice ? "estop" : "stop");
    },
    true,
  );
})();
