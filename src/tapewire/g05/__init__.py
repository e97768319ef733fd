"""Binary input operation (B-63322EN-1 chapter 9): travel per unit time, straight to the servos."""
