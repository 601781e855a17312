"""What a forked daemon needs; imported once by the server of `tests.forked`, with all compiled code."""

import hapticd.cli.run
import hapticd.cli.state
import hapticd.service.foreground  # noqa: F401
