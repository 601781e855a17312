"""The control API as it is declared: every endpoint once, for the server, the client, the command line and the document."""
