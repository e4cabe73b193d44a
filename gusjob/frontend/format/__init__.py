"""One layout for all jobs: what `gusjob fmt` writes."""

from gusjob.frontend.format.layout import formatted, laid_out

__all__ = ["formatted", "laid_out"]
