// Starts the page.

import { showDoor } from "./door.js";
import { Estop } from "./estop.js";
import { watchHeader } from "./header.js";
import { Live } from "./live.js";
import { openSession } from "./session.js";
import { Connection } from "./socket.js";
import { Views } from "./views.js";

const live = new Live();
const connection = new Connection(live);
const app = { live, connection, onStop: new Set() }; // Every control that a thumb holds lets go when the stop is pressed.

const session = openSession(); // It takes the token out of the address before the views read it.
app.estop = new Estop(connection, live, () => app.onStop.forEach((letGo) => letGo()));
watchHeader(connection, live);
const views = new Views(app);
live.on("problem", () => {
  views.close();
  showDoor();
});

try {
  const { problem } = await session;
  if (problem) live.emit("problem", { text: problem });
  else connection.connect();
} catch {
  connection.connect(); // It reports that there is no connection, and tries again.
}
