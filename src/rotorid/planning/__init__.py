"""What a planned flight will be able to tell, before it is flown."""
