"""What an ordinary flight tells, part by part: values, no page."""
