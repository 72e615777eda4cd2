"""The page itself, on viser: scene, panel and visitors; the only room that knows viser."""
