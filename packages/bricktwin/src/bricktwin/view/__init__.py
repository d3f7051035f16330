"""View: how a body and its surroundings are drawn in a browser, by the live page and by pages that
have no server."""
