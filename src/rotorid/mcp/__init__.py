"""Commands as tools of programs that speak the Model Context Protocol, inside the folders that a user names."""
