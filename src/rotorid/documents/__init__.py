"""What the JSON files hold, and their schemas."""
