"""The other end of a link: emulated boards, and who a board says it is."""
