// The page: its parts, put together.

import { BoardState } from "./board.js";
import { Bench } from "./bench.js";
import { Compare } from "./compare.js";
import { Devices } from "./devices.js";
import { Jobs } from "./jobs.js";
import { Live } from "./live.js";
import { endLeaseWithPage } from "./lease.js";
import { route } from "./route.js";
import { Runs } from "./runs.js";
import { watchSafe } from "./safe.js";
import { token } from "./session.js";
import { watchState } from "./state-band.js";

token();
const live = new Live();
watchSafe(live);
const state = new BoardState(live);
watchState(state, live);
const bench = new Bench(live, state);
route({ bench, runs: new Runs(live), compare: new Compare(), devices: new Devices(), jobs: new Jobs(live) });
endLeaseWithPage();
live.open();
