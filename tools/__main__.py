"""`python -m tools` makes all generated files anew, from the root of the tree, and says which of them changed."""

from pathlib import Path

from tools.generated import PAGES, WHOLE, text_of


def main(root: Path = Path()) -> None:
    """Raises OSError where `root` is not the tree."""
    for name in (*PAGES, *WHOLE):
        place = root / name
        now = place.read_text(encoding="utf-8")
        text = text_of(name, now)
        if text != now:
            place.write_text(text, encoding="utf-8")
            print(name)


if __name__ == "__main__":
    main()
