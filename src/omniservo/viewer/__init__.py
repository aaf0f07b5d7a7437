"""The live page: a path that is planned again while obstacles, start and goal are dragged."""

from omniservo.viewer.open_viewed import Viewed, open_viewed
from omniservo.viewer.serve_page import require_viser, serve_page

__all__ = ["Viewed", "open_viewed", "require_viser", "serve_page"]
