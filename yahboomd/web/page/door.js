// A page without a session: how to get in, and no control that would be refused.

import { el } from "./dom.js";

export function showDoor() {
  for (const id of ["views", "stop"]) document.getElementById(id).hidden = true;
  document.body.classList.add("shut");
  document.getElementById("main").replaceChildren(
    el(
      "section",
      { class: "door" },
      el("h2", {}, "How to get in"),
      el(
        "ol",
        {},
        el("li", {}, "On the robot's computer, have a link made: ", el("code", {}, "yahboomd web --show-link"), ", with ", el("code", {}, "sudo"), " for the service."),
        el("li", {}, "Scan its code with this phone's camera, or open the link. It lets one phone in, once, within 15 minutes."),
      ),
      el("p", {}, "Until then this page cannot stop the robot either: use its own switch."),
    ),
  );
}
