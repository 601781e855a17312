"""The declaration of the control API: each endpoint once, for server, client, command line and OpenAPI document."""
