"""What every chapter shows with: pictures, sliders, listings, checks, one style."""
