// Who we are to the service: the token that `hil serve` prints in the address, and our name as holder of a lease.
// The token stands in the fragment, which no server sees; it is kept for this tab and taken out of the address.

const TOKEN = "gyrohil.token";
const NAME = "gyrohil.name";

/** @returns {string} the token, or "" where none was given */
export function token() {
  const match = location.hash.match(/^#(?:.*[?&])?token=([^&]+)/);
  if (match) {
    sessionStorage.setItem(TOKEN, decodeURIComponent(match[1]));
    history.replaceState(null, "", location.pathname + location.search + "#/bench");
  }
  return sessionStorage.getItem(TOKEN) ?? "";
}

/** @returns {string} the name under which this page holds a board; the same as long as the tab is open */
export function holder() {
  let name = sessionStorage.getItem(NAME);
  if (!name) {
    const two = crypto.getRandomValues(new Uint8Array(2));
    name = `page ${[...two].map((byte) => byte.toString(16).padStart(2, "0")).join("")}`;
    sessionStorage.setItem(NAME, name);
  }
  return name;
}
