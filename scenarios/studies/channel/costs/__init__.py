"""What loss, bursts and latency cost the last vehicle of a convoy.

drives        drives over many channels, and what each cost
figure        them as a picture and as JSON
cost_picture  the picture
"""
