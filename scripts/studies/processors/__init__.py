"""The tests as other processors would run them."""
